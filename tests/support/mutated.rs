//! Texts with a few tokens changed, for tests of what reads texts. Equal seeds give equal changes.

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

/// SplitMix64.
struct Random(u64);

impl Random {
    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        usize::try_from((z ^ (z >> 31)) % count.max(1) as u64).expect("no larger than the count")
    }
}

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
    let mut list = tokens(text);
    for _ in 0..=random.below(5) {
        if list.is_empty() {
            break;
        }
        let (at, other) = (random.below(list.len()), random.below(list.len()));
        match random.below(6) {
            0 => drop(list.drain(at..(at + 1 + random.below(6)).min(list.len()))),
            1 => {
                let run = list[at..(at + 1 + random.below(12)).min(list.len())].to_vec();
                list.splice(other..other, run);
            }
            2 => list.swap(at, other),
            3 => list[at] = list[other],
            _ => {
                // Most other tokens are names and signs, whose change is refused at once.
                let numbers: Vec<usize> =
                    (0..list.len()).filter(|&i| list[i].starts_with(|c: char| c.is_ascii_digit())).collect();
                let place = if numbers.is_empty() { at } else { numbers[random.below(numbers.len())] };
                list[place] = NUMBERS[random.below(NUMBERS.len())];
            }
        }
    }
    list.concat()
}
