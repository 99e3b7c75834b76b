//! The server of a conversation: what it knows of open documents, and what it says to every message.
//!
//! Invariant: every request has one answer. What cannot be read of a notification is left out: there is nobody to tell.

use super::document::{Document, Position};
use lsp_server::{Connection, ErrorCode, Message, Notification, Request, Response};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;
use tpm_codegen::findings;
use tpm_symbolic::budget::Budget;

/// How long the server waits for more typing before it reads a text.
const PAUSE: Duration = Duration::from_millis(50);

/// How a conversation ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ended {
    AsAsked,
    InTheMiddle,
    Unheard,
}

/// How far a conversation has come.
#[derive(PartialEq)]
enum State {
    New,
    Running,
    ShutDown,
}

/// A fault of a request: its code and what is wrong.
type Refused = (ErrorCode, String);

#[derive(Deserialize)]
struct Identifier {
    uri: String,
}

#[derive(Deserialize)]
struct Opened {
    uri: String,
    text: String,
    #[serde(default)]
    version: Option<i64>,
}

#[derive(Deserialize)]
struct Change {
    text: String,
    range: Option<Value>,
}

#[derive(Deserialize)]
struct Versioned {
    uri: String,
    #[serde(default)]
    version: Option<i64>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct About<T> {
    text_document: T,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Changed {
    text_document: Versioned,
    content_changes: Vec<Change>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Place {
    text_document: Identifier,
    position: Position,
}

/// A conversation with an editor.
pub(super) struct Server<'a> {
    connection: &'a Connection,
    /// The version that the editor is told.
    version: &'a str,
    allows_large: bool,
    state: State,
    documents: BTreeMap<String, Document>,
    /// Documents of which nothing has been said since they changed.
    unread: BTreeSet<String>,
}

/// The other side does not listen any more.
#[derive(Debug)]
pub(super) struct Closed;

impl<'a> Server<'a> {
    /// A conversation that has not begun. Models may be large where `allows_large`.
    pub(super) fn new(connection: &'a Connection, version: &'a str, allows_large: bool) -> Self {
        let (documents, unread) = (BTreeMap::new(), BTreeSet::new());
        Self { connection, version, allows_large, state: State::New, documents, unread }
    }

    /// Talks until the conversation ends.
    pub(super) fn serve(mut self) -> Ended {
        loop {
            let received = if self.unread.is_empty() {
                self.connection.receiver.recv().ok()
            } else {
                match self.connection.receiver.recv_timeout(PAUSE) {
                    Ok(message) => Some(message),
                    Err(error) if error.is_timeout() => {
                        if self.read_next().is_err() {
                            return Ended::Unheard;
                        }
                        continue;
                    }
                    Err(_) => None,
                }
            };
            let Some(message) = received else { return Ended::InTheMiddle };
            match self.hear(message) {
                Ok(None) => {}
                Ok(Some(ended)) => return ended,
                Err(Closed) => return Ended::Unheard,
            }
        }
    }

    /// Takes in a message, and says whether the conversation ends with it.
    ///
    /// # Errors
    /// When nobody takes the answer.
    pub(super) fn hear(&mut self, message: Message) -> Result<Option<Ended>, Closed> {
        match message {
            Message::Request(request) => self.answer(request)?,
            Message::Notification(own) if own.method == "exit" => {
                return Ok(Some(if self.state == State::ShutDown { Ended::AsAsked } else { Ended::InTheMiddle }));
            }
            Message::Notification(notification) => self.take(notification)?,
            Message::Response(_) => {}
        }
        Ok(None)
    }

    fn send(&self, message: impl Into<Message>) -> Result<(), Closed> {
        self.connection.sender.send(message.into()).map_err(|_| Closed)
    }

    fn answer(&mut self, request: Request) -> Result<(), Closed> {
        let Request { id, method, params } = request;
        let result = self.result(&method, params);
        self.send(match result {
            Ok(result) => Response::new_ok(id, result),
            Err((code, message)) => Response::new_err(id, code as i32, message),
        })
    }

    fn result(&mut self, method: &str, params: Value) -> Result<Value, Refused> {
        match (&self.state, method) {
            (State::New, "initialize") => {
                self.state = State::Running;
                Ok(self.capabilities())
            }
            (State::New, _) => Err((ErrorCode::ServerNotInitialized, format!("`{method}` comes before `initialize`"))),
            (State::ShutDown, _) => Err((ErrorCode::InvalidRequest, format!("`{method}` comes after `shutdown`"))),
            (State::Running, "shutdown") => {
                self.state = State::ShutDown;
                Ok(Value::Null)
            }
            (State::Running, "textDocument/hover") => {
                let Place { text_document, position } = parsed(params)?;
                Ok(self.document(&text_document)?.hover(position))
            }
            (State::Running, "textDocument/completion") => {
                let Place { text_document, .. } = parsed(params)?;
                Ok(self.document(&text_document)?.completion())
            }
            (State::Running, "textDocument/formatting") => {
                let About { text_document } = parsed(params)?;
                Ok(self.document(&text_document)?.formatting())
            }
            (State::Running, "initialize") => Err((ErrorCode::InvalidRequest, "`initialize` comes once".to_owned())),
            _ => Err((ErrorCode::MethodNotFound, format!("this server does not know `{method}`"))),
        }
    }

    /// What the server can do: whole documents, positions in UTF-16.
    fn capabilities(&self) -> Value {
        json!({
            "capabilities": {
                "positionEncoding": "utf-16",
                "textDocumentSync": { "openClose": true, "change": 1 },
                "hoverProvider": true,
                "completionProvider": {},
                "documentFormattingProvider": true,
            },
            "serverInfo": { "name": "tpm", "version": self.version },
        })
    }

    fn document(&self, of: &Identifier) -> Result<&Document, Refused> {
        let missing = || (ErrorCode::InvalidParams, format!("{} is not open", of.uri));
        self.documents.get(&of.uri).ok_or_else(missing)
    }

    /// Takes in what needs no answer.
    fn take(&mut self, notification: Notification) -> Result<(), Closed> {
        let params = notification.params;
        if self.state != State::Running {
            return Ok(());
        }
        match notification.method.as_str() {
            "textDocument/didOpen" => {
                if let Ok(About::<Opened> { text_document: Opened { uri, text, version } }) = parsed(params) {
                    self.hold(uri, text, version);
                }
            }
            "textDocument/didChange" => {
                if let Ok(Changed { text_document, content_changes }) = parsed(params)
                    && let Some(Change { text, range: None }) = content_changes.into_iter().last()
                {
                    self.hold(text_document.uri, text, text_document.version);
                }
            }
            "textDocument/didClose" => {
                if let Ok(About::<Identifier> { text_document }) = parsed(params) {
                    self.documents.remove(&text_document.uri);
                    self.unread.remove(&text_document.uri);
                    return self.publish(&text_document.uri, None, &json!([]));
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn hold(&mut self, uri: String, text: String, version: Option<i64>) {
        self.unread.insert(uri.clone());
        let document = Document::new(&uri, text, version);
        self.documents.insert(uri, document);
    }

    /// Says what is to be said of one of the texts that changed.
    ///
    /// # Errors
    /// When nobody takes it.
    pub(super) fn read_next(&mut self) -> Result<(), Closed> {
        let Some(uri) = self.unread.pop_first() else { return Ok(()) };
        let Some(document) = self.documents.get(&uri) else { return Ok(()) };
        let budget = if self.allows_large { Budget::large() } else { Budget::default() };
        let found = findings(document.source(), budget, "start the server as `tpm lsp --allow-large`");
        self.publish(&uri, document.version(), &document.diagnostics(&uri, &found))
    }

    fn publish(&self, uri: &str, version: Option<i64>, diagnostics: &Value) -> Result<(), Closed> {
        let mut params = json!({ "uri": uri, "diagnostics": diagnostics });
        if let Some(version) = version {
            params["version"] = json!(version);
        }
        self.send(Notification { method: "textDocument/publishDiagnostics".to_owned(), params })
    }
}

fn parsed<T: DeserializeOwned>(params: Value) -> Result<T, Refused> {
    serde_json::from_value(params).map_err(|error| (ErrorCode::InvalidParams, error.to_string()))
}
