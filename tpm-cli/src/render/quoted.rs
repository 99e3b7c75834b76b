//! Words of a command line that is printed, as a shell reads them back.

use std::borrow::Cow;

/// A word as a shell of the kind of `sh` takes it: as it is, in double quotes, or in single ones where something in it means more.
pub(crate) fn quoted(word: &str) -> Cow<'_, str> {
    let plain = |c: char| c.is_alphanumeric() || "_-./=:,+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return Cow::Borrowed(word);
    }
    if word.contains(['$', '`', '\\', '"', '!']) {
        return Cow::Owned(format!("'{}'", word.replace('\'', r"'\''")));
    }
    Cow::Owned(format!("\"{word}\""))
}

/// A command line.
pub(crate) fn command(words: &[String]) -> String {
    words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::{command, quoted};

    #[test]
    fn a_shell_reads_the_words_back() {
        assert_eq!(quoted("run_1.csv"), "run_1.csv");
        assert_eq!(quoted("x=Output angle [deg]"), "\"x=Output angle [deg]\"");
        for word in
            ["", "a b", "it's", "cost $5", "`date`", "say \"no\"", "back\\slash", "wow!", "a;b", "*", "ü°", "-a&b"]
        {
            let line = format!("printf %s {}", quoted(word));
            let output = std::process::Command::new("sh").args(["-c", &line]).output().expect("a shell");
            assert_eq!(String::from_utf8_lossy(&output.stdout), word, "{line}");
        }
        let words = ["tpm", "init", "my log.csv"].map(str::to_owned);
        assert_eq!(command(&words), "tpm init \"my log.csv\"");
    }
}
