//! Texts with a few tokens changed, for tests of what reads texts. Equal seeds give equal changes.

use super::random::Random;

/// Numbers that readers are tempted to trust.
const NUMBERS: [&str; 16] = [
    "0",
    "-1",
    "1e308",
    "1e-308",
    "1e999",
    "nan",
    "inf",
    "4294967296",
    "18446744073709551616",
    "0.1",
    "1/3",
    "2147483648",
    "255",
    "1000000",
    "007",
    "1e3",
];

/// Words, numbers, and every other letter by itself.
fn tokens(text: &str) -> Vec<&str> {
    let (mut found, mut start) = (Vec::new(), None);
    for (at, letter) in text.char_indices() {
        if letter.is_alphanumeric() || letter == '_' || letter == '.' {
            start.get_or_insert(at);
            continue;
        }
        if let Some(start) = start.take() {
            found.push(&text[start..at]);
        }
        found.push(&text[at..at + letter.len_utf8()]);
    }
    found.extend(start.map(|start| &text[start..]));
    found
}

/// The text with one to five of its tokens, or short runs of them, removed, repeated, exchanged or replaced.
pub(crate) fn mutated(text: &str, seed: u64) -> String {
    let mut random = Random(seed);
    let mut below = |count: usize| usize::try_from(random.below(count as u64)).expect("no larger than the count");
    let mut list = tokens(text);
    for _ in 0..=below(5) {
        if list.is_empty() {
            break;
        }
        let (at, other) = (below(list.len()), below(list.len()));
        match below(6) {
            0 => drop(list.drain(at..(at + 1 + below(6)).min(list.len()))),
            1 => {
                let run = list[at..(at + 1 + below(12)).min(list.len())].to_vec();
                list.splice(other..other, run);
            }
            2 => list.swap(at, other),
            3 => list[at] = list[other],
            _ => {
                // Most other tokens are names and signs, whose change is refused at once.
                let numbers: Vec<usize> =
                    (0..list.len()).filter(|&i| list[i].starts_with(|c: char| c.is_ascii_digit())).collect();
                let place = if numbers.is_empty() { at } else { numbers[below(numbers.len())] };
                list[place] = NUMBERS[below(NUMBERS.len())];
            }
        }
    }
    list.concat()
}

/// The text with other values: one in six of the decimal numbers by a factor near one, and one in forty of the whole ones by one, unless
/// they are versions (`tpm.run/1`). What is left of its meaning is whole, so that most readers take it.
pub(crate) fn varied(text: &str, seed: u64) -> String {
    let mut random = Random(seed);
    let mut before = "";
    let mut other = |token: &str| {
        if token.contains('.') {
            let value: f64 = token.parse().ok().filter(|_| random.below(6) == 0)?;
            return Some(format!("{:?}", value * (0.5 + random.below(1000) as f64 / 1000.0)));
        }
        let value: u32 = token.parse().ok().filter(|_| random.below(40) == 0)?;
        Some(value.saturating_add(1).to_string())
    };
    let varied = tokens(text).into_iter().map(|token| {
        let found = other(token).filter(|_| before != "/");
        before = token;
        found.unwrap_or_else(|| token.to_owned())
    });
    varied.collect()
}
