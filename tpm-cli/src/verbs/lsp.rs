//! `tpm lsp`: the server with which editors talk about models, by the language server protocol.
//!
//! Documents are sent whole, since models are short. What is said of a text is found once nothing more comes in, so that fast
//! typing is not answered letter by letter.

mod document;
mod findings;
mod transport;

use crate::failure::{Failure, Outcome};
use crossbeam_channel::bounded;
use document::{Document, Position};
use lsp_server::{Connection, ErrorCode, Message, Notification, Request, Response};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::io::IsTerminal as _;
use std::time::Duration;
use tpm_symbolic::budget;

/// How long the server waits for more typing before it reads a text.
const PAUSE: Duration = Duration::from_millis(50);

/// Options of `tpm lsp`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Talk over standard input and output, as is done without it too; many editors say so.
    #[arg(long)]
    stdio: bool,
    /// What does not belong here, for the sentence that says so.
    #[arg(hide = true, allow_hyphen_values = true)]
    others: Vec<String>,
}

/// What to do instead of starting the server by hand.
const HINT: &str =
    "an editor starts `tpm lsp` (docs/editors.md says how); type `tpm check FILE` for what it says of one file";

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    // There is no other way to talk, so that saying so changes nothing.
    let Args { stdio: _, others } = args;
    if let Some(other) = others.first() {
        return Err(Failure::Input(format!("`tpm lsp` takes nothing such as `{other}`: {HINT}")));
    }
    if std::io::stdin().is_terminal() {
        return Err(Failure::Input(format!("nobody types the language server protocol by hand: {HINT}")));
    }
    let allows_large = budget::allows_large();
    // A message is handed over before the next one is read.
    let ((sender, heard), (said, receiver)) = (bounded(0), bounded::<Message>(0));
    let reading = std::thread::spawn(move || {
        transport::read_all(&mut std::io::stdin().lock(), |message| said.send(message).is_ok())
    });
    let writing = std::thread::spawn(move || {
        heard.into_iter().try_for_each(|message: Message| message.write(&mut std::io::stdout().lock()))
    });
    let connection = Connection { sender, receiver };
    // The work that a model may ask for is counted by thread, and here every text has a count of its own.
    let serving = std::thread::spawn(move || Server::new(&connection, allows_large).serve());
    let ended = serving.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    // The connection has gone with the server, so that this ends once all is written or nobody takes it.
    let _ = writing.join();
    match ended {
        Ended::AsAsked => Ok(()),
        // Nobody listens any more; the thread that reads may wait for ever.
        Ended::Unheard => Err(Failure::Incomplete("the editor has closed the connection".to_owned())),
        Ended::InTheMiddle => match reading.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)) {
            Ok(()) => Err(Failure::Incomplete(format!("the connection ended without `shutdown` and `exit`: {HINT}"))),
            Err(error) => {
                let reason: String = error.chars().take(200).collect();
                Err(Failure::Input(format!(
                    "what came in is no message of the language server protocol ({reason}); {HINT}"
                )))
            }
        },
    }
}

/// How a conversation ended.
enum Ended {
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

struct Server<'a> {
    connection: &'a Connection,
    allows_large: bool,
    state: State,
    documents: BTreeMap<String, Document>,
    /// Documents of which nothing has been said since they changed.
    unread: BTreeSet<String>,
}

/// The other side does not listen any more.
struct Closed;

impl<'a> Server<'a> {
    fn new(connection: &'a Connection, allows_large: bool) -> Self {
        Self { connection, allows_large, state: State::New, documents: BTreeMap::new(), unread: BTreeSet::new() }
    }

    fn serve(mut self) -> Ended {
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
            let sent = match received {
                None => return Ended::InTheMiddle,
                Some(Message::Request(request)) => self.answer(request),
                Some(Message::Notification(own)) if own.method == "exit" => {
                    return if self.state == State::ShutDown { Ended::AsAsked } else { Ended::InTheMiddle };
                }
                Some(Message::Notification(notification)) => self.take(notification),
                Some(Message::Response(_)) => Ok(()),
            };
            if sent.is_err() {
                return Ended::Unheard;
            }
        }
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
                Ok(capabilities())
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

    fn document(&self, of: &Identifier) -> Result<&Document, Refused> {
        let missing = || (ErrorCode::InvalidParams, format!("{} is not open", of.uri));
        self.documents.get(&of.uri).ok_or_else(missing)
    }

    /// Takes in what needs no answer. What cannot be read is left out: there is nobody to tell.
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
    fn read_next(&mut self) -> Result<(), Closed> {
        let Some(uri) = self.unread.pop_first() else { return Ok(()) };
        let Some(document) = self.documents.get(&uri) else { return Ok(()) };
        let found = findings::of(document.source(), self.allows_large);
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

/// What the server can do: whole documents, positions in UTF-16.
fn capabilities() -> Value {
    json!({
        "capabilities": {
            "positionEncoding": "utf-16",
            "textDocumentSync": { "openClose": true, "change": 1 },
            "hoverProvider": true,
            "completionProvider": {},
            "documentFormattingProvider": true,
        },
        "serverInfo": { "name": "tpm", "version": env!("TPM_VERSION") },
    })
}
