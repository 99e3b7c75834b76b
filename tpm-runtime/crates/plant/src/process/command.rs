//! The splitting of a command line into words.

/// The words of a command: they are separated by blanks, and text between single or double quotes is taken literally.
/// No shell is used, so that the process that is started and ended is the program itself.
///
/// # Errors
/// In words, when there is no word, or a quote is not closed.
pub(super) fn words(command: &str) -> Result<Vec<String>, String> {
    let (mut words, mut word, mut quote) = (Vec::new(), None::<String>, None::<char>);
    for character in command.chars() {
        match (quote, character) {
            (Some(open), _) if character == open => quote = None,
            (None, '"' | '\'') => {
                quote = Some(character);
                word.get_or_insert_default();
            }
            (None, _) if character.is_whitespace() => words.extend(word.take()),
            _ => word.get_or_insert_default().push(character),
        }
    }
    if let Some(open) = quote {
        return Err(format!("the quote {open} is not closed"));
    }
    words.extend(word);
    if words.is_empty() { Err("it names no program".to_string()) } else { Ok(words) }
}

#[cfg(test)]
mod tests {
    use super::words;

    #[test]
    fn blanks_separate_and_quotes_keep() {
        let split = |command: &str| words(command).expect("right");
        assert_eq!(split(" python3  machine.py --mass 2 "), ["python3", "machine.py", "--mass", "2"]);
        assert_eq!(split("sh -c 'echo \"a  b\"' \"\""), ["sh", "-c", "echo \"a  b\"", ""]);
        assert_eq!(split(r"C:\tools\machine.exe --name=my' 'arm"), [r"C:\tools\machine.exe", "--name=my arm"]);
        assert!(words("sh -c 'echo").expect_err("open").contains("' is not closed"));
        assert!(words("  ").is_err());
    }
}
