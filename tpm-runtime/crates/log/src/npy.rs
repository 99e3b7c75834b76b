//! Arrays of NumPy: a file with one (`.npy`), and archives with several (`.npz`).
//!
//! An array is a magic number, a header in Python's syntax with its type, order and shape, and its items. A vector is a column, a
//! matrix one for every column, its longer side being time, an array of records one for every field. Dates and time spans
//! (`datetime64`, `timedelta64`) are counted from the first one in their own unit, so that no digit is lost. Arrays of text, of complex
//! numbers and of more than two dimensions are not read.

use crate::error::LogError;
use crate::packed::{MOST_UNPACKED, Room};
use crate::stored::{Stored, StoredColumn};
use flate2::bufread::DeflateDecoder;
use rawzip::{CompressionMethod, ZipArchive};
use std::io::Read;

/// The first bytes of an array.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";
/// End of the names of arrays in an archive.
const EXTENSION: &str = ".npy";
/// Longest header; those of arrays with hundreds of fields have some thousand characters.
const LONGEST_HEADER: usize = 1 << 20;
/// Deepest nesting of brackets in a header.
const DEEPEST: usize = 8;

/// A value in Python's syntax.
enum Literal {
    Text(String),
    Number(usize),
    Truth(bool),
    List(Vec<Literal>),
    Dictionary(Vec<(String, Literal)>),
}

impl Literal {
    /// Splits the first value off a text; nothing where it is none.
    fn split(rest: &mut &str, depth: usize) -> Option<Self> {
        *rest = rest.trim_start();
        let first = rest.chars().next().filter(|_| depth < DEEPEST)?;
        match first {
            '\'' | '"' => {
                let (text, behind) = rest[1..].split_once(first)?;
                *rest = behind;
                Some(Literal::Text(text.to_owned()))
            }
            '(' | '[' => {
                let close = if first == '(' { ')' } else { ']' };
                let mut items = Vec::new();
                *rest = &rest[1..];
                while !closes(rest, close) {
                    items.push(Literal::split(rest, depth + 1)?);
                    separates(rest, close)?;
                }
                Some(Literal::List(items))
            }
            '{' => {
                let mut items = Vec::new();
                *rest = &rest[1..];
                while !closes(rest, '}') {
                    let Literal::Text(key) = Literal::split(rest, depth + 1)? else { return None };
                    *rest = rest.trim_start().strip_prefix(':')?;
                    items.push((key, Literal::split(rest, depth + 1)?));
                    separates(rest, '}')?;
                }
                Some(Literal::Dictionary(items))
            }
            _ => {
                let end = rest.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(rest.len());
                let (word, behind) = rest.split_at(end);
                *rest = behind;
                match word {
                    "True" => Some(Literal::Truth(true)),
                    "False" => Some(Literal::Truth(false)),
                    number => number.trim_end_matches('L').parse().ok().map(Literal::Number),
                }
            }
        }
    }
}

/// Whether a list ends here; its bracket is then split off.
fn closes(rest: &mut &str, close: char) -> bool {
    *rest = rest.trim_start();
    let behind = rest.strip_prefix(close);
    *rest = behind.unwrap_or(rest);
    behind.is_some()
}

/// Splits off the comma behind an item, which may be missing behind the last one.
fn separates(rest: &mut &str, close: char) -> Option<()> {
    *rest = rest.trim_start();
    let Some(behind) = rest.strip_prefix(',') else { return rest.starts_with(close).then_some(()) };
    *rest = behind;
    Some(())
}

/// What the bytes of an item mean.
#[derive(Clone, Copy)]
enum Kind {
    Float,
    Signed,
    Unsigned,
    /// Counts of a unit of time, which are taken from the first one.
    Time(&'static str),
}

/// A part of an item: a number, several, or what is no number.
struct Field {
    name: String,
    /// Nothing for what is no number.
    kind: Option<Kind>,
    big: bool,
    /// Bytes of one number, or of the whole field.
    size: usize,
    count: usize,
}

impl Field {
    /// A field of a simple type such as `<f8`; nothing where its size is not known.
    fn of(name: &str, kind: &str, count: usize) -> Option<Self> {
        let own = kind.trim_start_matches(['<', '>', '|', '=']);
        let (letter, rest) = own.split_at_checked(1)?;
        let (digits, unit) = rest.split_once('[').map_or((rest, ""), |(digits, unit)| (digits, unit));
        let bytes: usize = digits.parse().ok()?;
        let time = match unit.trim_end_matches(']') {
            "h" => Some(Kind::Time("h")),
            "m" => Some(Kind::Time("min")),
            "s" => Some(Kind::Time("s")),
            "ms" => Some(Kind::Time("ms")),
            "us" => Some(Kind::Time("us")),
            "ns" => Some(Kind::Time("ns")),
            _ => None,
        };
        let number = match (letter, bytes) {
            ("f", 2 | 4 | 8) => Some(Kind::Float),
            ("i", 1 | 2 | 4 | 8) => Some(Kind::Signed),
            ("u", 1 | 2 | 4 | 8) | ("b", 1) => Some(Kind::Unsigned),
            ("M" | "m", 8) => time,
            _ => None,
        };
        let size = if letter == "U" { bytes.checked_mul(4)? } else { bytes };
        Some(Field { name: name.to_owned(), kind: number, big: kind.starts_with('>'), size, count })
    }

    /// The fields of an item: of one simple type, or of a record.
    fn all(description: &Literal) -> Option<Vec<Self>> {
        match description {
            Literal::Text(kind) => Some(vec![Field::of("", kind, 1)?]),
            Literal::List(fields) => fields.iter().map(Field::of_record).collect(),
            _ => None,
        }
    }

    /// A field of a record: its name (or title and name), its type, and perhaps a shape.
    fn of_record(field: &Literal) -> Option<Self> {
        let Literal::List(parts) = field else { return None };
        let name = match parts.first()? {
            Literal::Text(name) => name,
            Literal::List(both) => match both.last()? {
                Literal::Text(name) => name,
                _ => return None,
            },
            _ => return None,
        };
        let count = match parts.get(2) {
            None => 1,
            Some(Literal::Number(count)) => *count,
            Some(shape) => sizes(shape)?.into_iter().try_fold(1, usize::checked_mul)?,
        };
        match parts.get(1)? {
            Literal::Text(kind) => Field::of(name, kind, count),
            _ => None,
        }
    }

    /// Bytes of the whole field.
    fn bytes(&self) -> Option<usize> {
        self.size.checked_mul(self.count)
    }

    /// The bits of a number, the least first.
    fn bits(&self, bytes: &[u8]) -> u64 {
        let shift = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
        if self.big { bytes.iter().fold(0, shift) } else { bytes.iter().rev().fold(0, shift) }
    }

    /// The readings of a field of numbers: those of its `part`-th number in every item, which are `stride` bytes apart.
    fn readings(&self, kind: Kind, items: &[u8], stride: usize, start: usize) -> Vec<f64> {
        let unused = 64 - 8 * self.size as u32;
        let bits = items.chunks_exact(stride).map(|item| self.bits(&item[start..start + self.size]));
        let signed = |bits: u64| (bits << unused) as i64 >> unused;
        match kind {
            Kind::Float if self.size == 8 => bits.map(f64::from_bits).collect(),
            Kind::Float if self.size == 4 => bits.map(|bits| f64::from(f32::from_bits(bits as u32))).collect(),
            Kind::Float => bits.map(half).collect(),
            Kind::Unsigned => bits.map(|bits| bits as f64).collect(),
            Kind::Signed => bits.map(|bits| signed(bits) as f64).collect(),
            Kind::Time(_) => {
                let counts: Vec<i64> = bits.map(signed).collect();
                let first = counts.iter().copied().find(|count| *count != i64::MIN).unwrap_or(0);
                let from_first =
                    |count: i64| if count == i64::MIN { f64::NAN } else { count.wrapping_sub(first) as f64 };
                counts.into_iter().map(from_first).collect()
            }
        }
    }
}

/// The value of a number of half precision.
fn half(bits: u64) -> f64 {
    let (sign, exponent, fraction) = (bits >> 15 & 1, (bits >> 10 & 0x1f) as i32, (bits & 0x3ff) as f64);
    let size = match exponent {
        0 => fraction * 2f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1024.0 + fraction) * 2f64.powi(exponent - 25),
    };
    if sign == 1 { -size } else { size }
}

/// The numbers of a shape.
fn sizes(shape: &Literal) -> Option<Vec<usize>> {
    let Literal::List(sizes) = shape else { return None };
    sizes.iter().map(|size| if let Literal::Number(size) = size { Some(*size) } else { None }).collect()
}

/// What an array holds.
enum Array {
    Columns(Vec<StoredColumn<'static>>),
    /// No readings: what it is instead.
    Other(&'static str),
}

/// The header of an array: type, order and shape; the items are left in `rest`.
fn header(rest: &mut &[u8]) -> Option<(Literal, bool, Vec<usize>)> {
    let bytes = rest.strip_prefix(MAGIC)?;
    let (length, start) = match bytes.first()? {
        1 => (u16::from_le_bytes(bytes.get(2..4)?.try_into().ok()?).into(), 4),
        _ => (u32::from_le_bytes(bytes.get(2..6)?.try_into().ok()?) as usize, 6),
    };
    let text = bytes.get(start..start + length.min(LONGEST_HEADER + 1)).filter(|text| text.len() <= LONGEST_HEADER)?;
    *rest = &bytes[start + length..];
    let text = String::from_utf8_lossy(text);
    let Literal::Dictionary(items) = Literal::split(&mut &*text, 0)? else { return None };
    let (mut kind, mut fortran, mut shape) = (None, None, None);
    for (key, value) in items {
        match (key.as_str(), value) {
            ("descr", value) => kind = Some(value),
            ("fortran_order", Literal::Truth(value)) => fortran = Some(value),
            ("shape", value) => shape = sizes(&value),
            _ => {}
        }
    }
    Some((kind?, fortran?, shape?))
}

/// The columns of an array of a name, which may be empty; nothing where it is damaged.
fn array(mut rest: &[u8], name: &str) -> Option<Array> {
    let (kind, fortran, shape) = header(&mut rest)?;
    let record = matches!(kind, Literal::List(_));
    let Some(fields) = Field::all(&kind) else { return Some(Array::Other("an array of objects or of nested records")) };
    let stride = fields.iter().try_fold(0, |sum: usize, field| sum.checked_add(field.bytes()?))?;
    let count = shape.iter().try_fold(1, |all: usize, size| all.checked_mul(*size))?;
    let items = rest.get(..count.checked_mul(stride)?)?;
    let wide = match shape[..] {
        _ if stride == 0 || count == 0 => return Some(Array::Other("an empty array")),
        [] => return Some(Array::Other("a single value")),
        [_] => 1,
        [_, wide] if !record => wide,
        _ => return Some(Array::Other("an array of too many dimensions")),
    };
    let mut columns = Vec::new();
    let mut start = 0;
    for field in &fields {
        let Some(kind) = field.kind else {
            start += field.bytes()?;
            continue;
        };
        let own = match (name, field.name.as_str()) {
            (name, "") => name.to_owned(),
            ("", own) => own.to_owned(),
            (name, own) => format!("{name}.{own}"),
        };
        let first = columns.len();
        if record {
            for part in 0..field.count {
                let readings = field.readings(kind, items, stride, start + part * field.size);
                let own = if field.count == 1 { own.clone() } else { format!("{own}[{}]", part + 1) };
                columns.push(StoredColumn::of(own, readings));
            }
        } else {
            // A matrix stored row by row is its transpose stored column by column.
            let readings = field.readings(kind, items, stride, start);
            let (rows, wide) = if fortran { (count / wide, wide) } else { (wide, count / wide) };
            columns.extend(StoredColumn::of_matrix(&own, readings, rows, wide));
        }
        if let Kind::Time(unit) = kind {
            columns[first..].iter_mut().for_each(|column| column.name.unit = Some(unit.to_owned()));
        }
        start += field.bytes()?;
    }
    Some(if columns.is_empty() { Array::Other("an array without real numbers") } else { Array::Columns(columns) })
}

fn fault(path: &str, what: String) -> LogError {
    let remedy = "save the signals as vectors of real numbers, with a name each (`numpy.savez`), or as CSV";
    LogError::Format { path: path.into(), what, remedy: remedy.into() }
}

fn whole(mut input: impl Read, path: &str) -> Result<Vec<u8>, LogError> {
    let mut bytes = Vec::new();
    input.read_to_end(&mut bytes).map_err(|source| LogError::Io { path: path.into(), source })?;
    Ok(bytes)
}

/// Whether a column has a name, not only a place.
fn is_named(name: &str) -> bool {
    !name.is_empty() && !name.starts_with('[')
}

/// Reads the array of a file; messages call it `path`.
///
/// # Errors
/// [`LogError`] when the file cannot be read, is damaged, or has no readings.
pub(super) fn read(input: impl Read, path: &str) -> Result<Stored<'static>, LogError> {
    match array(&whole(input, path)?, "") {
        Some(Array::Columns(columns)) if columns.iter().all(|column| is_named(&column.name.text)) => {
            Ok(Stored::new(path, columns))
        }
        Some(Array::Columns(columns)) => Ok(Stored::numbered(path, columns)),
        Some(Array::Other(what)) => Err(fault(path, format!("the NumPy file holds {what}"))),
        None => Err(fault(path, "the NumPy file is cut short or damaged".into())),
    }
}

/// Reads the arrays of a ZIP archive, one after the other; messages call it `path`.
///
/// # Errors
/// [`LogError`] when the file cannot be read, is damaged, unpacks to too much, is another archive, or has no readings.
pub(super) fn read_archive(input: impl Read, path: &str) -> Result<Stored<'static>, LogError> {
    let bytes = whole(input, path)?;
    let damaged = || fault(path, "the ZIP archive is cut short or damaged".into());
    let archive = ZipArchive::from_slice(&bytes).map_err(|_| damaged())?;
    let (mut names, mut columns, mut others) = (Vec::new(), Vec::new(), Vec::new());
    // What entries say of their length is not relied on, nor that no two of them are the same bytes.
    let mut room = Room::of_file(bytes.len());
    for entry in archive.entries() {
        let entry = entry.map_err(|_| damaged())?;
        let file = String::from_utf8_lossy(entry.file_path().as_bytes()).into_owned();
        let Some(name) = file.strip_suffix(EXTENSION) else { continue };
        if names.iter().any(|other| other == name) {
            return Err(fault(path, format!("the NumPy archive has two arrays `{name}`")));
        }
        let packed = archive.get_entry(entry.wayfinder()).map_err(|_| damaged())?;
        let unpacked = match entry.compression_method() {
            CompressionMethod::STORE => room.unpack(packed.verifying_reader(packed.data())),
            CompressionMethod::DEFLATE => room.unpack(packed.verifying_reader(DeflateDecoder::new(packed.data()))),
            _ => {
                return Err(fault(
                    path,
                    format!("`{name}` in the NumPy archive is packed in another way than deflate"),
                ));
            }
        };
        let Some(unpacked) = unpacked.map_err(|_| damaged())? else {
            let limit = MOST_UNPACKED >> 20;
            return Err(fault(path, format!("the NumPy archive unpacks to more than {limit} MiB at `{name}`")));
        };
        match array(&unpacked, name) {
            Some(Array::Columns(own)) => columns.extend(own),
            Some(Array::Other(what)) => others.push(format!("`{name}` ({what})")),
            None => return Err(fault(path, format!("the array `{name}` is cut short or damaged"))),
        }
        names.push(name.to_owned());
    }
    if names.is_empty() {
        return Err(LogError::Format {
            path: path.into(),
            what: "the file is a ZIP archive or a spreadsheet".into(),
            remedy: "save the table as UTF-8 text in columns (CSV)".into(),
        });
    }
    if columns.is_empty() {
        return Err(fault(path, format!("the NumPy archive has no readings, only {}", others.join(", "))));
    }
    Ok(Stored::new(path, columns))
}

#[cfg(test)]
mod tests {
    use super::{half, read, read_archive};
    use crate::columns::Columns as _;

    const ARCHIVE: &[u8] = include_bytes!("../../../../tests/fixtures/logs/arrays.npz");
    const RECORDS: &[u8] = include_bytes!("../../../../tests/fixtures/logs/records.npy");

    #[test]
    fn arrays_are_columns() {
        let file = read_archive(ARCHIVE, "run.npz").expect("sound");
        let names: Vec<&str> = file.header().iter().map(|column| column.text.as_str()).collect();
        let expected =
            ["t_s", "x", "u", "both[1]", "both[2]", "wide[1]", "wide[2]", "fortran[1]", "fortran[2]", "half"];
        assert!(expected.iter().all(|name| names.contains(name)), "{names:?}");
        assert!(!names.contains(&"note") && !names.contains(&"setting"), "{names:?}");
        let unit = |name: &str| file.header().iter().find(|column| column.text == name).and_then(|c| c.unit.clone());
        assert_eq!(unit("date"), Some("ns".into()));
        let file = read(RECORDS, "run.npy").expect("sound");
        let names: Vec<&str> = file.header().iter().map(|column| column.text.as_str()).collect();
        assert_eq!(names, ["stamp", "x", "u", "joint[1]", "joint[2]"]);
    }

    #[test]
    fn halves_are_exact() {
        let halves =
            [(0x3c00, 1.0), (0xc000, -2.0), (0x0001, 2f64.powi(-24)), (0x7bff, 65504.0), (0x3555, 0.333_251_953_125)];
        for (bits, value) in halves {
            assert_eq!(half(bits), value);
        }
        assert!(half(0x7c01).is_nan() && half(0xfc00) == f64::NEG_INFINITY);
    }

    /// An archive of one array of zeros, packed, which says that it unpacks to `says` bytes.
    fn zeros(count: usize, says: usize) -> Vec<u8> {
        let mut array = b"\x93NUMPY\x01\x00\x40\x00".to_vec();
        array.extend(
            format!("{:63}\n", format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({count},), }}")).bytes(),
        );
        array.resize(array.len() + 8 * count, 0);
        let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::fast());
        std::io::Write::write_all(&mut encoder, &array).expect("memory takes it");
        let packed = encoder.finish().expect("memory takes it");
        let mut sum = flate2::Crc::new();
        sum.update(&array);
        let long = |value: usize| (value as u32).to_le_bytes();
        let mut common = vec![20, 0, 0, 0, 8, 0, 0, 0, 0, 0];
        common.extend([sum.sum().to_le_bytes(), long(packed.len()), long(says)].concat());
        common.extend([5, 0, 0, 0]);
        let entry = [b"PK\x03\x04", &common[..], b"x.npy", &packed].concat();
        let directory = [b"PK\x01\x02\x14\x00", &common[..], &[0; 14], b"x.npy"].concat();
        let end = [b"PK\x05\x06\0\0\0\0\x01\0\x01\0", &long(directory.len())[..], &long(entry.len()), &[0; 2]].concat();
        [entry, directory, end].concat()
    }

    #[test]
    fn archives_unpack_to_what_the_memory_holds() {
        let file = read_archive(&zeros(1000, 8074)[..], "run.npz").expect("sound");
        assert_eq!(file.header().len(), 1);
        // Neither what is too much is unpacked, nor is it believed to be little.
        for says in [8 * 35_000_000 + 74, 100] {
            let message = read_archive(&zeros(35_000_000, says)[..], "run.npz").err().expect("too much").to_string();
            let named = message.contains("more than 256 MiB at `x`") || says == 100 && message.contains("damaged");
            assert!(named, "{says}: {message}");
        }
    }

    #[test]
    fn damaged_files_are_refused() {
        for length in [0, 5, 6, 9, 60, 200, RECORDS.len() - 1] {
            assert!(read(&RECORDS[..length], "run.npy").is_err(), "{length}");
        }
        for length in [0, 4, 30, 500, ARCHIVE.len() - 1] {
            assert!(read_archive(&ARCHIVE[..length], "run.npz").is_err(), "{length}");
        }
        for (fixture, archive) in [(RECORDS, false), (ARCHIVE, true)] {
            let mut damaged = fixture.to_vec();
            for at in (0..fixture.len()).step_by(5) {
                damaged[at] ^= 0x55;
                let _ = if archive { read_archive(&damaged[..], "run").err() } else { read(&damaged[..], "run").err() };
                damaged[at] ^= 0x55;
            }
        }
        // Shapes whose product is no number of bytes, and brackets without an end.
        for shape in ["(99999999999, 99999999999)", "(3,", "((((((((((((1,),),),),),),),),),),)"] {
            let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n");
            let mut file = b"\x93NUMPY\x01\x00".to_vec();
            file.extend((header.len() as u16).to_le_bytes());
            file.extend(header.bytes());
            assert!(read(&file[..], "run.npy").is_err(), "{shape}");
        }
    }
}
