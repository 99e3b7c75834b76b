//! `tpm lsp`: the server with which editors talk about models, by the language server protocol.
//!
//! Documents are sent whole, since models are short. What is said of a text is found once nothing more comes in, so that fast
//! typing is not answered letter by letter.

mod document;
mod server;
mod transport;

use crate::failure::{Failure, Outcome};
use crossbeam_channel::bounded;
use lsp_server::{Connection, Message};
use server::{Ended, Server};
use std::io::IsTerminal as _;
use tpm_symbolic::budget;

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
    let serving = std::thread::spawn(move || Server::new(&connection, env!("TPM_VERSION"), allows_large).serve());
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
