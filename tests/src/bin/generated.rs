//! The generated sources that tests compile, and what is kept of them in `tests/generated`.
//!
//! ```text
//! cargo run -p tpm-tests --bin generated -- write FOLDER    all texts
//! cargo run -p tpm-tests --bin generated -- difference      how they differ from those of the last commit
//! cargo run -p tpm-tests --bin generated -- accept          keeps them as they are now
//! ```

use std::error::Error;
use std::io::Write as _;
use std::path::Path;
use tpm_tests::goldens;

fn main() -> Result<(), Box<dyn Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().ok_or("this crate is in no workspace")?;
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let sources = goldens::all(root);
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["write", folder] => goldens::write(Path::new(folder), &sources)?,
        ["accept"] => goldens::accept(root, &sources)?,
        ["difference"] => {
            let stale = goldens::Kept::read(root)?.stale(&sources);
            let program = std::env::current_exe()?;
            let target = program.ancestors().nth(2).ok_or("this program is in no folder of cargo's")?;
            let text = match stale.is_empty() {
                true => "all sources are as they are kept\n".to_owned(),
                false => goldens::difference(root, &target.join("tmp/generated"), &sources, &stale),
            };
            std::io::stdout().write_all(text.as_bytes())?;
        }
        _ => return Err("usage: generated write FOLDER | difference | accept".into()),
    }
    Ok(())
}
