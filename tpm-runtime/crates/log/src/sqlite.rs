//! Tables of SQLite databases, read from the bytes of the file.
//!
//! A database is a row of pages of one size. A table is a tree of pages: leaves hold rows, other pages lead to them; a row that is too
//! long for its page goes on in a chain of others. A row is the types of its fields and then their contents. Page 1 begins the table of
//! all tables, behind a header of a hundred bytes.

/// The first bytes of a database.
pub(super) const MAGIC: &[u8] = b"SQLite format 3\x00";
/// Bytes of the header of the file.
const HEADER_BYTES: usize = 100;
/// Places in it: the size of a page, the version that reads, bytes at the end of a page that are not used, the coding of texts.
const PAGE_SIZE_AT: usize = 16;
const READ_VERSION_AT: usize = 19;
const RESERVED_AT: usize = 20;
const TEXT_CODING_AT: usize = 56;
/// The version that keeps what was written last in a file of its own beside the database.
const WRITE_AHEAD: u8 = 2;
const UTF8: u32 = 1;
/// Kinds of pages of a table: those that lead to others, and leaves.
const INTERIOR: u8 = 0x05;
const LEAF: u8 = 0x0d;
/// Deepest tree; one of pages with two branches would hold more rows than a file can.
const DEEPEST: usize = 40;

/// A field of a row.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value<'a> {
    Null,
    Integer(i64),
    Real(f64),
    Text(String),
    Blob(std::borrow::Cow<'a, [u8]>),
}

/// A row with its number, which stands for a field that is the integer key.
pub(super) struct Row<'a> {
    pub(super) number: i64,
    pub(super) fields: Vec<Value<'a>>,
}

/// A table: its name, where its tree begins, and the names of its columns.
pub(super) struct Table {
    pub(super) name: String,
    root: u32,
    columns: Vec<String>,
}

impl Table {
    /// The place of a column.
    pub(super) fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|own| own.eq_ignore_ascii_case(name))
    }
}

/// A database in memory.
pub(super) struct Database<'a> {
    bytes: &'a [u8],
    page: usize,
    /// Bytes of a page that are used.
    usable: usize,
}

/// A number of up to nine bytes, seven bits in each but the last, and the bytes behind it.
fn varint(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let mut value = 0_u64;
    for (k, byte) in bytes.iter().enumerate().take(9) {
        if k == 8 {
            return Some((value << 8 | u64::from(*byte), &bytes[9..]));
        }
        value = value << 7 | u64::from(byte & 0x7f);
        if byte & 0x80 == 0 {
            return Some((value, &bytes[k + 1..]));
        }
    }
    None
}

fn u16_at(bytes: &[u8], at: usize) -> Option<usize> {
    Some(u16::from_be_bytes(bytes.get(at..at + 2)?.try_into().ok()?).into())
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_be_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

impl<'a> Database<'a> {
    /// The database of a file; nothing where its header is damaged.
    pub(super) fn of(bytes: &'a [u8]) -> Option<Self> {
        let header = bytes.get(..HEADER_BYTES).filter(|header| header.starts_with(MAGIC))?;
        let page = match u16_at(header, PAGE_SIZE_AT)? {
            1 => 1 << 16,
            size => size,
        };
        let usable = page.checked_sub(header[RESERVED_AT].into())?;
        let sound = page.is_power_of_two() && page >= 512 && usable >= 480;
        let utf8 = matches!(u32_at(header, TEXT_CODING_AT), Some(0 | UTF8));
        (sound && utf8).then_some(Database { bytes, page, usable })
    }

    /// Whether what was written last may lie in another file.
    pub(super) fn writes_ahead(&self) -> bool {
        self.bytes[READ_VERSION_AT] == WRITE_AHEAD
    }

    fn page(&self, number: u32) -> Option<&'a [u8]> {
        let start = (number as usize).checked_sub(1)?.checked_mul(self.page)?;
        self.bytes.get(start..start.checked_add(self.page)?)
    }

    /// The tables of the database; nothing where it is damaged.
    pub(super) fn tables(&self) -> Option<Vec<Table>> {
        let mut tables = Vec::new();
        self.rows(1, &mut |row| {
            if let [Value::Text(kind), Value::Text(name), _, Value::Integer(root), Value::Text(sql)] = &row.fields[..]
                && kind == "table"
            {
                tables.push(Table { name: name.clone(), root: u32::try_from(*root).ok()?, columns: columns(sql) });
            }
            Some(())
        })?;
        Some(tables)
    }

    /// Takes the rows of a table one after another; nothing where it is damaged, or where `take` says so.
    pub(super) fn each(&self, table: &Table, mut take: impl FnMut(Row<'a>) -> Option<()>) -> Option<()> {
        self.rows(table.root, &mut take)
    }

    fn rows(&self, root: u32, take: &mut dyn FnMut(Row<'a>) -> Option<()>) -> Option<()> {
        // A page belongs to one place: a file of so many pages has no more to visit.
        let mut left = self.bytes.len() / self.page;
        self.branch(root, 0, &mut left, take)
    }

    fn branch(
        &self,
        number: u32,
        depth: usize,
        left: &mut usize,
        take: &mut dyn FnMut(Row<'a>) -> Option<()>,
    ) -> Option<()> {
        *left = left.checked_sub(1).filter(|_| depth < DEEPEST)?;
        let page = self.page(number)?;
        let header = if number == 1 { HEADER_BYTES } else { 0 };
        let kind = *page.get(header)?;
        let cells = u16_at(page, header + 3)?;
        let pointers = header + if kind == INTERIOR { 12 } else { 8 };
        for cell in 0..cells {
            let cell = page.get(u16_at(page, pointers + 2 * cell)?..self.usable)?;
            match kind {
                INTERIOR => self.branch(u32_at(cell, 0)?, depth + 1, left, take)?,
                LEAF => take(self.row(cell, left)?)?,
                _ => return None,
            }
        }
        match kind {
            INTERIOR => self.branch(u32_at(page, header + 8)?, depth + 1, left, take),
            LEAF => Some(()),
            _ => None,
        }
    }

    /// The row of a cell of a leaf.
    fn row(&self, cell: &'a [u8], left: &mut usize) -> Option<Row<'a>> {
        let (length, rest) = varint(cell)?;
        let (number, rest) = varint(rest)?;
        let length = usize::try_from(length).ok().filter(|length| *length <= self.bytes.len())?;
        let number = number as i64;
        if length <= self.usable - 35 {
            return Some(Row { number, fields: fields(rest.get(..length)?, std::borrow::Cow::Borrowed)? });
        }
        // The part of a long row that stays in its page.
        let least = (self.usable - 12) * 32 / 255 - 23;
        let part = least + (length - least) % (self.usable - 4);
        let part = if part <= self.usable - 35 { part } else { least };
        let mut whole = rest.get(..part)?.to_vec();
        let mut next = u32_at(rest, part)?;
        while whole.len() < length {
            *left = left.checked_sub(1)?;
            let page = self.page(next)?;
            next = u32_at(page, 0)?;
            let part = (length - whole.len()).min(self.usable - 4);
            whole.extend(&page[4..4 + part]);
        }
        Some(Row { number, fields: fields(&whole, |bytes| std::borrow::Cow::Owned(bytes.to_vec()))? })
    }
}

/// The fields of a row.
fn fields<'b, 'a>(row: &'b [u8], blob: impl Fn(&'b [u8]) -> std::borrow::Cow<'a, [u8]>) -> Option<Vec<Value<'a>>> {
    let (header, behind) = varint(row)?;
    let header = usize::try_from(header).ok()?;
    let mut kinds = row.get(row.len() - behind.len()..header)?;
    let mut contents = row.get(header..)?;
    let mut fields = Vec::new();
    while !kinds.is_empty() {
        let (kind, rest) = varint(kinds)?;
        kinds = rest;
        let length = match kind {
            0 | 8 | 9 => 0,
            1..=4 => kind,
            5 => 6,
            6 | 7 => 8,
            10 | 11 => return None,
            _ => (kind - 12) / 2,
        };
        let (content, rest) = contents.split_at_checked(usize::try_from(length).ok()?)?;
        contents = rest;
        let integer = || {
            let negative = content.first().is_some_and(|byte| byte & 0x80 != 0);
            content.iter().fold(if negative { -1_i64 } else { 0 }, |sum, byte| sum << 8 | i64::from(*byte))
        };
        fields.push(match kind {
            0 => Value::Null,
            8 | 9 => Value::Integer(kind as i64 - 8),
            1..=6 => Value::Integer(integer()),
            7 => Value::Real(f64::from_bits(integer() as u64)),
            _ if kind % 2 == 0 => Value::Blob(blob(content)),
            _ => Value::Text(String::from_utf8_lossy(content).into_owned()),
        });
    }
    Some(fields)
}

/// The names of the columns in the statement that made a table.
fn columns(sql: &str) -> Vec<String> {
    let inner = sql.split_once('(').map_or("", |(_, inner)| inner);
    let mut depth = 0;
    let parts = inner.split(|sign: char| {
        depth += match sign {
            '(' => 1,
            ')' => -1,
            _ => 0,
        };
        sign == ',' && depth == 0
    });
    let name = |part: &str| {
        part.split_whitespace().next().map(|name| name.trim_matches(['"', '`', '[', ']', '\'']).to_owned())
    };
    parts.filter_map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::{Database, Value, columns, varint};

    const FIXTURE: &[u8] = include_bytes!("../../../../tests/fixtures/logs/tables.db3");

    #[test]
    fn rows_of_every_kind_and_length_are_read() {
        let database = Database::of(FIXTURE).expect("sound");
        let tables = database.tables().expect("sound");
        let table = tables.iter().find(|table| table.name == "things").expect("a table");
        assert_eq!(table.column("whole"), Some(1));
        assert_eq!(table.column("none"), None);
        let mut count = 0;
        // Row k holds k squared with either sign, its root, as many characters, and bytes over several pages.
        let read = database.each(table, |row| {
            count += 1;
            let k = row.number;
            let [Value::Null, Value::Integer(whole), real, Value::Text(text), Value::Blob(blob)] = &row.fields[..]
            else {
                panic!("row {k}: {:?}", row.fields);
            };
            assert_eq!(*whole, k.pow(6) * if k % 2 == 0 { 1 } else { -1 });
            let root = (k as f64).sqrt();
            assert!(*real == Value::Real(root) || *real == Value::Integer(root as i64), "{real:?}");
            assert_eq!(text.chars().count() as i64, k % 50);
            let bytes = (0..k * 11).map(|n| (n % 251) as u8);
            assert!(blob.iter().copied().eq(bytes), "row {k}");
            Some(())
        });
        assert!(read.is_some());
        assert_eq!(count, 120);
    }

    #[test]
    fn damaged_databases_are_refused() {
        let take = |bytes: &[u8]| {
            let database = Database::of(bytes)?;
            database.tables()?.iter().try_for_each(|table| database.each(table, |_| Some(())))
        };
        assert!(take(FIXTURE).is_some());
        for length in [0, 16, 99, 100, 600, FIXTURE.len() / 2] {
            assert!(take(&FIXTURE[..length]).is_none(), "{length}");
        }
        let mut damaged = FIXTURE.to_vec();
        for at in (0..FIXTURE.len()).step_by(101).chain(0..200) {
            damaged[at] ^= 0x55;
            let _ = take(&damaged);
            damaged[at] ^= 0x55;
        }
    }

    #[test]
    fn numbers_and_statements_are_split() {
        assert_eq!(varint(&[0x81, 0x00, 7]), Some((128, &[7][..])));
        assert_eq!(varint(&[0xff; 9]), Some((u64::MAX, &[][..])));
        assert_eq!(varint(&[0x80]), None);
        let sql = "CREATE TABLE a(id INTEGER PRIMARY KEY, \"two words\" DECIMAL(5, 2), `c` BLOB NOT NULL)";
        assert_eq!(columns(sql)[0], "id");
        assert_eq!(columns(sql).len(), 3);
        assert_eq!(columns(sql)[2], "c");
    }
}
