//! MAT-files of MATLAB 5 to 7.2.
//!
//! A file is a header of 128 bytes and a list of elements, each with its type and its length; an element may be compressed (zlib). A
//! numeric variable is a column for every one of its columns: `q` for a vector, `q[1]`, `q[2]`, ... for a matrix, whose longer
//! side is time. What lies in structures and cells is called by its path, `log.signals.values`; where Simulink states a label beside the
//! values, by that. Other variables, such as objects, are not read.

use crate::error::LogError;
use crate::packed::{MOST_UNPACKED, Room};
use crate::stored::{Stored, StoredColumn};
use flate2::read::ZlibDecoder;
use std::io::Read;

/// Length of the header, and place in it of the mark of the byte order.
const HEADER_BYTES: usize = 128;
const BYTE_ORDER_AT: usize = 126;
/// Types of elements.
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;
/// Classes of arrays of cells and of structures, and how deep they are followed.
const CELL: u32 = 1;
const STRUCTURE: u32 = 2;
const MOST_DEPTH: usize = 32;
/// Classes of arrays of real numbers: double, single, and the integers.
const NUMERIC: std::ops::RangeInclusive<u32> = 6..=15;
/// Flag of an array with an imaginary part.
const COMPLEX: u32 = 0x800;

/// Order of the bytes of a number.
#[derive(Clone, Copy)]
enum Order {
    Little,
    Big,
}

impl Order {
    fn u32(self, bytes: [u8; 4]) -> u32 {
        match self {
            Order::Little => u32::from_le_bytes(bytes),
            Order::Big => u32::from_be_bytes(bytes),
        }
    }
}

/// An element: its type and its bytes.
struct Element<'a> {
    kind: u32,
    bytes: &'a [u8],
}

/// Splits the first element off; nothing where it is cut short.
fn element<'a>(rest: &mut &'a [u8], order: Order) -> Option<Element<'a>> {
    let word = |at: usize| Some(order.u32(rest.get(at..at + 4)?.try_into().ok()?));
    let first = word(0)?;
    // An element of up to four bytes is stored within its tag.
    let (kind, length, start, end): (u32, usize, usize, usize) = if first >> 16 != 0 {
        (first & 0xffff, (first >> 16) as usize, 4, 8)
    } else {
        let length = word(4)? as usize;
        (first, length, 8, 8 + length.checked_next_multiple_of(8)?)
    };
    let bytes = rest.get(start..start.checked_add(length)?)?;
    *rest = rest.get(end..).unwrap_or_default();
    Some(Element { kind, bytes })
}

/// The numbers of an element.
fn numbers(element: &Element<'_>, order: Order) -> Option<Vec<f64>> {
    macro_rules! read {
        ($number:ty) => {{
            let chunks = element.bytes.chunks_exact(size_of::<$number>());
            chunks
                .map(|chunk| {
                    let bytes = chunk.try_into().ok()?;
                    Some(match order {
                        Order::Little => <$number>::from_le_bytes(bytes) as f64,
                        Order::Big => <$number>::from_be_bytes(bytes) as f64,
                    })
                })
                .collect()
        }};
    }
    match element.kind {
        1 => read!(i8),
        2 => read!(u8),
        3 => read!(i16),
        4 => read!(u16),
        5 => read!(i32),
        6 => read!(u32),
        7 => read!(f32),
        9 => read!(f64),
        12 => read!(i64),
        13 => read!(u64),
        _ => None,
    }
}

/// What was found in the variables of a file.
#[derive(Default)]
struct Found {
    columns: Vec<StoredColumn<'static>>,
    /// The names of arrays that are not of real numbers.
    others: Vec<String>,
}

impl Found {
    /// Takes in the variable of the bytes of a matrix, by its own name or, within another, by its path; nothing where they are cut short.
    fn take(&mut self, mut rest: &[u8], order: Order, path: Option<&str>, depth: usize) -> Option<()> {
        let flags = element(&mut rest, order)?;
        let class = order.u32(flags.bytes.get(..4)?.try_into().ok()?);
        let dimensions = numbers(&element(&mut rest, order)?, order)?;
        let count = dimensions.iter().try_fold(1_usize, |count, size| count.checked_mul(*size as usize))?;
        let own = element(&mut rest, order)?;
        let name = path.map_or_else(|| text(own.bytes), str::to_owned);
        match class & 0xff {
            STRUCTURE | CELL if depth < MOST_DEPTH => {
                let fields =
                    if class & 0xff == STRUCTURE { fields(&mut rest, order) } else { Some(vec![String::new()]) };
                fields.map_or(Some(()), |fields| self.take_parts(rest, order, &name, &fields, (count, depth + 1)))
            }
            kind if !NUMERIC.contains(&kind) || class & COMPLEX != 0 => {
                self.others.push(name);
                Some(())
            }
            _ => {
                let values = numbers(&element(&mut rest, order)?, order)?;
                if count != values.len() {
                    return None;
                }
                // Of more than two dimensions the last one is time.
                let columns = dimensions.last().map_or(0, |columns| *columns as usize);
                self.columns.extend(StoredColumn::of_matrix(
                    &name,
                    values,
                    count.checked_div(columns).unwrap_or(0),
                    columns,
                ));
                Some(())
            }
        }
    }

    /// Takes in the parts of a structure, of an array of structures or of a cell by their paths: `a.b`, `a[2].b`, `a{2}`.
    fn take_parts(
        &mut self,
        mut rest: &[u8],
        order: Order,
        name: &str,
        fields: &[String],
        (count, depth): (usize, usize),
    ) -> Option<()> {
        for k in 1..=count {
            let (mut label, mut of_values) = (None, 0..0);
            for field in fields {
                let part = element(&mut rest, order)?;
                let path = match (field.as_str(), count) {
                    ("", _) => format!("{name}{{{k}}}"),
                    (field, 1) => format!("{name}.{field}"),
                    (field, _) => format!("{name}[{k}].{field}"),
                };
                if part.bytes.is_empty() {
                    continue;
                }
                if field == "label" {
                    label = characters(part.bytes, order);
                }
                let before = self.columns.len();
                self.take(part.bytes, order, Some(&path), depth)?;
                if field == "values" {
                    of_values = before..self.columns.len();
                }
            }
            // Simulink names the columns of `values` in a label beside them.
            let labels = label.unwrap_or_default();
            let labels: Vec<&str> = labels.split(',').map(|label| label.trim().trim_matches(['<', '>'])).collect();
            if labels.len() == of_values.len() && labels.iter().all(|label| !label.is_empty()) {
                for (column, label) in self.columns[of_values].iter_mut().zip(labels) {
                    let stem = column.name.text.rfind(".values").map_or(0, |at| at + 1);
                    column.name.text = format!("{}{label}", &column.name.text[..stem]);
                }
            }
        }
        Some(())
    }
}

/// The names of the fields of a structure.
fn fields(rest: &mut &[u8], order: Order) -> Option<Vec<String>> {
    let length = numbers(&element(rest, order)?, order)?.first().map(|length| *length as usize)?;
    let names = element(rest, order)?;
    // Structures without fields hold nothing, however many there are.
    (length > 0 && !names.bytes.is_empty()).then(|| names.bytes.chunks(length).map(text).collect())
}

fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into()
}

/// The text of an array of characters.
fn characters(mut rest: &[u8], order: Order) -> Option<String> {
    for _ in 0..3 {
        element(&mut rest, order)?;
    }
    let signs = element(&mut rest, order)?;
    // UTF-8, or a number for every sign.
    if signs.kind == 16 {
        return Some(text(signs.bytes));
    }
    numbers(&signs, order)?.into_iter().map(|code| char::from_u32(code as u32)).collect()
}

/// Reads the numeric variables of a MAT-file; messages call it `path`.
///
/// # Errors
/// [`LogError`] when the file cannot be read, is cut short, or has no numeric variables.
pub(super) fn read(mut input: impl Read, path: &str) -> Result<Stored<'static>, LogError> {
    let io = |source| LogError::Io { path: path.into(), source };
    let fault = |what: String| LogError::Format {
        path: path.into(),
        what,
        remedy: "save the signals once more, as vectors with `save -v7`, or as CSV".into(),
    };
    let cut = || fault("the MAT-file is cut short or damaged".to_string());
    let mut header = Vec::new();
    input.by_ref().take(HEADER_BYTES as u64).read_to_end(&mut header).map_err(io)?;
    let order = match header.get(BYTE_ORDER_AT..HEADER_BYTES) {
        Some(b"IM") => Order::Little,
        Some(b"MI") => Order::Big,
        _ => return Err(cut()),
    };
    let (mut found, mut room) = (Found::default(), Room::new());
    loop {
        let mut tag = Vec::new();
        input.by_ref().take(8).read_to_end(&mut tag).map_err(io)?;
        if tag.is_empty() {
            break;
        }
        let word = |at: usize| tag.get(at..at + 4).and_then(|bytes| Some(order.u32(bytes.try_into().ok()?)));
        let (kind, length) = word(0).zip(word(4)).ok_or_else(cut)?;
        let mut bytes = Vec::new();
        input.by_ref().take(length.into()).read_to_end(&mut bytes).map_err(io)?;
        if bytes.len() != length as usize {
            return Err(cut());
        }
        let matrix = match kind {
            MATRIX => bytes,
            COMPRESSED => {
                let inner = room.unpack(ZlibDecoder::new(&bytes[..])).map_err(|_| cut())?;
                let inner = inner.ok_or_else(|| {
                    let most = MOST_UNPACKED >> 20;
                    fault(format!("the packed variables of the MAT-file are more than {most} MiB; save fewer of them"))
                })?;
                match element(&mut &inner[..], order) {
                    Some(Element { kind: MATRIX, bytes }) => bytes.to_vec(),
                    Some(_) => continue,
                    None => return Err(cut()),
                }
            }
            _ => continue,
        };
        found.take(&matrix, order, None, 0).ok_or_else(cut)?;
    }
    if found.columns.is_empty() {
        let only = if found.others.is_empty() { String::new() } else { format!(", only {}", found.others.join(", ")) };
        return Err(fault(format!("the MAT-file has no vectors of real numbers{only}")));
    }
    Ok(Stored::new(path, found.columns))
}

#[cfg(test)]
mod tests {
    use super::{Element, Order, numbers, read};
    use crate::columns::Columns as _;

    const FIXTURE: &[u8] = include_bytes!("../../../../tests/fixtures/logs/matlab5.mat");

    #[test]
    fn vectors_and_columns_of_matrices_are_columns() {
        let file = read(FIXTURE, "run.mat").expect("sound");
        let names: Vec<&str> = file.header().iter().map(|column| column.text.as_str()).collect();
        for name in ["t_s", "x_mm", "u", "both[1]", "both[2]", "counts", "wide[1]", "wide[2]"] {
            assert!(names.contains(&name), "{name}: {names:?}");
        }
        assert!(!names.contains(&"single") && !names.contains(&"setting"), "{names:?}");
    }

    #[test]
    fn numbers_of_every_type_are_read() {
        for (kind, bytes, number) in [
            (1, &[0xff][..], -1.0),
            (2, &[0xff][..], 255.0),
            (3, &[0xfe, 0xff][..], -2.0),
            (4, &[0xfe, 0xff][..], 65_534.0),
            (5, &[0xff; 4][..], -1.0),
            (6, &[0xff; 4][..], 4_294_967_295.0),
            (7, &[0, 0, 0xc0, 0x3f][..], 1.5),
            (9, &1.5f64.to_le_bytes()[..], 1.5),
            (12, &[0xff; 8][..], -1.0),
            (13, &[0xff; 8][..], u64::MAX as f64),
        ] {
            let turned: Vec<u8> = bytes.iter().rev().copied().collect();
            for (bytes, order) in [(bytes, Order::Little), (&turned[..], Order::Big)] {
                assert_eq!(numbers(&Element { kind, bytes }, order), Some(vec![number]), "{kind}");
            }
        }
    }

    /// An element: its type and its bytes, filled up to eight.
    fn part(kind: u32, bytes: &[u8]) -> Vec<u8> {
        let mut all = [kind.to_le_bytes(), (bytes.len() as u32).to_le_bytes()].concat();
        all.extend_from_slice(bytes);
        all.resize(all.len().next_multiple_of(8), 0);
        all
    }

    /// An array of a class with its dimensions and what follows them.
    fn array(class: u32, name: &str, dimensions: [i32; 2], rest: &[u8]) -> Vec<u8> {
        let flags = part(6, &[class.to_le_bytes(), [0; 4]].concat());
        let sizes = part(5, &dimensions.map(i32::to_le_bytes).concat());
        part(14, &[flags, sizes, part(1, name.as_bytes()), rest.to_vec()].concat())
    }

    fn doubles(dimensions: [i32; 2]) -> Vec<u8> {
        let values: Vec<u8> = (0..dimensions[0] * dimensions[1]).flat_map(|k| f64::from(k).to_le_bytes()).collect();
        array(6, "", dimensions, &part(9, &values))
    }

    fn structure(name: &str, dimensions: [i32; 2], fields: &[&str], values: &[Vec<u8>]) -> Vec<u8> {
        let names: Vec<u8> = fields.iter().flat_map(|field| format!("{field:\0<16}").into_bytes()).collect();
        array(2, name, dimensions, &[part(5, &16_i32.to_le_bytes()), part(1, &names), values.concat()].concat())
    }

    #[test]
    fn structures_are_followed_by_their_paths_and_labels() {
        let label = |text: &str| array(4, "", [1, text.len() as i32], &part(16, text.as_bytes()));
        let both = structure("", [1, 1], &["values", "label"], &[doubles([5, 2]), label("u, <x>")]);
        let each =
            structure("", [1, 2], &["values", "label"], &[doubles([5, 1]), label("a"), doubles([5, 2]), label("")]);
        let time =
            |name: &str, signals: Vec<u8>| structure(name, [1, 1], &["time", "signals"], &[doubles([5, 1]), signals]);
        let mut file = FIXTURE[..128].to_vec();
        file.extend([time("out", both), time("more", each), array(1, "c", [1, 1], &doubles([1, 5]))].concat());
        let read_all = read(&file[..], "run.mat").expect("sound");
        let names: Vec<&str> = read_all.header().iter().map(|column| column.text.as_str()).collect();
        let more = ["more.time", "more.signals[1].a", "more.signals[2].values[1]", "more.signals[2].values[2]", "c{1}"];
        assert_eq!(names, [&["out.time", "out.signals.u", "out.signals.x"][..], &more].concat());
        // Wherever such a file is damaged it is refused or read, at once.
        for at in 128..file.len() {
            for damaged in [0xff, 0x01] {
                let mut file = file.clone();
                file[at] ^= damaged;
                let _ = read(&file[..], "run.mat");
            }
        }
    }

    #[test]
    fn damaged_files_are_refused() {
        for length in [0, 100, 128, 131, 140, 200, 1000, FIXTURE.len() - 1] {
            assert!(read(&FIXTURE[..length], "run.mat").is_err(), "{length}");
        }
        let mut damaged = FIXTURE.to_vec();
        for at in (128..FIXTURE.len()).step_by(3) {
            damaged[at] ^= 0x55;
            let _ = read(&damaged[..], "run.mat");
            damaged[at] ^= 0x55;
        }
    }
}
