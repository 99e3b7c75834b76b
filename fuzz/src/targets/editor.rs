//! Conversations with an editor, by the language server protocol: every request has one answer.

use super::mutated::mutated;
use super::random::Random;
use super::{Verdict, models, refused};
use lsp_server::{Connection, Message, RequestId};
use serde_json::{Value, json};
use server::{Ended, Server};
use std::io::Cursor;

#[path = "../../../tpm-cli/src/verbs/lsp/document.rs"]
mod document;
#[allow(dead_code, reason = "the program waits for messages, which are all there here")]
#[path = "../../../tpm-cli/src/verbs/lsp/server.rs"]
mod server;
#[path = "../../../tpm-cli/src/verbs/lsp/transport.rs"]
mod transport;

/// A message as it is sent.
fn framed(body: &str) -> String {
    format!("Content-Length: {}\r\n\r\n{body}", body.len())
}

/// A place in a document, often beyond its end.
fn place(random: &mut Random) -> Value {
    let most = *random.of(&[3, 12, 80, u64::from(u32::MAX)]);
    json!({ "line": random.below(most), "character": random.below(most) })
}

/// A conversation from the first message to the last, one in three of them with a message changed, one in twelve changed as a whole.
pub(super) fn text(random: &mut Random) -> String {
    let mut bodies = Vec::new();
    let mut say = |method: &str, id: Option<u64>, params: Value| {
        let mut message = json!({ "jsonrpc": "2.0", "method": method, "params": params });
        if let Some(id) = id {
            message["id"] = json!(id);
        }
        bodies.push(message.to_string());
    };
    say("initialize", Some(1), json!({ "capabilities": {} }));
    say("initialized", None, json!({}));
    let uri = |random: &mut Random| format!("file:///{}.tpm", random.below(3));
    let mut model = models::text(random);
    for id in 2..3 + random.below(9) {
        let uri = uri(random);
        let document = json!({ "uri": uri });
        match random.below(9) {
            0..=2 => {
                let document = json!({ "uri": uri, "languageId": "tpm", "version": id, "text": model });
                say("textDocument/didOpen", None, json!({ "textDocument": document }));
            }
            3 => {
                model = mutated(&model, random.next());
                let changes = json!([{ "text": model }]);
                let document = json!({ "uri": uri, "version": id });
                say("textDocument/didChange", None, json!({ "textDocument": document, "contentChanges": changes }));
            }
            4 => say("textDocument/didClose", None, json!({ "textDocument": document })),
            5 => say("textDocument/formatting", Some(id), json!({ "textDocument": document, "options": {} })),
            6 => {
                say("textDocument/completion", Some(id), json!({ "textDocument": document, "position": place(random) }))
            }
            7 => say("textDocument/hover", Some(id), json!({ "textDocument": document, "position": place(random) })),
            _ => say("workspace/symbol", Some(id), json!({ "query": "m" })),
        }
    }
    say("shutdown", Some(99), Value::Null);
    say("exit", None, Value::Null);
    if random.below(3) == 0 {
        let at = usize::try_from(random.below(bodies.len() as u64)).expect("an index");
        bodies[at] = mutated(&bodies[at], random.next());
    }
    let all: String = bodies.iter().map(|body| framed(body)).collect();
    if random.below(12) == 0 { mutated(&all, random.next()) } else { all }
}

/// A conversation up to its end. It is answered where it ends as the protocol says.
pub(super) fn conversation(text: &str) -> Verdict {
    let mut messages = Vec::new();
    let read = transport::read_all(&mut Cursor::new(text.as_bytes()), |message| {
        messages.push(message);
        true
    });
    let (own, other) = Connection::memory();
    let mut server = Server::new(&own, "0", false);
    let (mut asked, mut ended) = (Vec::new(), None);
    for message in messages {
        if let Message::Request(request) = &message {
            asked.push(request.id.clone());
        }
        ended = server.hear(message).expect("the answers are taken");
        server.read_next().expect("the findings are taken");
    }
    let answered: Vec<RequestId> = other
        .receiver
        .try_iter()
        .filter_map(|message| match message {
            Message::Response(response) => Some(response.id),
            _ => None,
        })
        .collect();
    assert_eq!(asked, answered, "requests and their answers");
    match (read, ended) {
        (Err(reason), _) => refused(&reason),
        (Ok(()), Some(Ended::AsAsked)) => Verdict::Answered,
        (Ok(()), _) => refused(&"the conversation ended without `shutdown` and `exit`"),
    }
}
