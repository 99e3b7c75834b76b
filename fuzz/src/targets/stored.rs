//! Binary logs as texts of hexadecimal digits: MAT-files, HDF5, MCAP, Parquet, arrays of NumPy, data logs and databases of other tools, one
//! in three with bytes changed, cut, repeated and lengths that lie; MAT-files, archives of arrays and MCAP of our own, some of which unpack
//! to far more than they are.

use super::random::Random;
use super::{Verdict, refused};
use flate2::Compression;
use flate2::write::{DeflateEncoder, ZlibEncoder};
use std::io::Write as _;
use std::path::Path;
use std::sync::OnceLock;
use tpm_runtime::log::{ReadingSettings, Recording};
use tpm_runtime::session::{DeclaredModel, Identifiable as _};

/// The files of other tools.
const FILES: [&str; 12] = [
    "arrays.npz",
    "joint_states.db3",
    "joint_states.mcap",
    "joint_states_lz4.mcap",
    "joint_states_zstd.mcap",
    "matlab5.mat",
    "matlab73.mat",
    "records.npy",
    "slider.h5",
    "slider.parquet",
    "slider.wpilog",
    "stored.npz",
];

/// Lengths and counts that readers are tempted to trust.
const LENGTHS: [u64; 10] = [0, 1, 7, 255, 65_536, 1 << 24, 0x7fff_ffff, 0xffff_ffff, 1 << 40, u64::MAX];

fn files() -> &'static [Vec<u8>] {
    static FOUND: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    FOUND.get_or_init(|| {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/logs");
        FILES.iter().map(|name| std::fs::read(folder.join(name)).expect("a file of another tool")).collect()
    })
}

/// A place in some bytes.
fn place(random: &mut Random, bytes: &[u8]) -> usize {
    usize::try_from(random.below(bytes.len() as u64)).expect("an index")
}

/// Bytes changed here and there.
fn bent(mut bytes: Vec<u8>, random: &mut Random) -> Vec<u8> {
    for _ in 0..=random.below(3) {
        if bytes.is_empty() {
            break;
        }
        let at = place(random, &bytes);
        let length = 1 + usize::try_from(random.below(64)).expect("small");
        let end = (at + length).min(bytes.len());
        match random.below(8) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = u8::try_from(random.below(256)).expect("a byte"),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..end)),
            4 => {
                let part = bytes[at..end].to_vec();
                bytes.splice(at..at, part);
            }
            5 => bytes[at..end].fill(0),
            _ => {
                let (value, big, wide) = (*random.of(&LENGTHS), random.below(2) == 0, random.below(2) == 0);
                let whole = if big { value.to_be_bytes() } else { value.to_le_bytes() };
                let width = if wide { 8 } else { 4 };
                let part = if big { &whole[8 - width..] } else { &whole[..width] };
                // Lengths mostly stand at even places.
                let at = at & !3;
                let width = width.min(bytes.len() - at);
                bytes[at..at + width].copy_from_slice(&part[..width]);
            }
        }
    }
    bytes
}

/// A number in an element of a MAT-file, whose length is a multiple of eight.
fn element(kind: u32, content: &[u8]) -> Vec<u8> {
    let length = u32::try_from(content.len()).expect("short");
    let mut bytes = [kind.to_le_bytes(), length.to_le_bytes()].concat();
    bytes.extend(content);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

/// A variable of doubles of a MAT-file.
fn matrix(name: &str, rows: u32, columns: u32, values: &[u8]) -> Vec<u8> {
    let class = [6_u32.to_le_bytes(), 0_u32.to_le_bytes()].concat();
    let size = [rows.to_le_bytes(), columns.to_le_bytes()].concat();
    let parts = [element(6, &class), element(5, &size), element(1, name.as_bytes()), element(9, values)].concat();
    element(14, &parts)
}

/// Megabytes of zeros that are packed where one in a thousand files is to unpack to more than a log has numbers.
fn bomb(random: &mut Random) -> Option<u32> {
    (random.below(1000) == 0).then(|| *random.of(&[10, 100, 400]))
}

/// A MAT-file of time, motion and force, packed or not, some with zeros without end.
fn mat(random: &mut Random) -> Vec<u8> {
    let mut file = vec![b' '; 124];
    file.extend([0, 1, b'I', b'M']);
    let rows = 20 + random.below(200);
    let column = |of: &dyn Fn(f64) -> f64| (0..rows).flat_map(|n| of(n as f64).to_le_bytes()).collect::<Vec<u8>>();
    let pack = random.below(2) == 0;
    let mut add = |variable: Vec<u8>, pack: bool| {
        if pack {
            let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
            encoder.write_all(&variable).expect("memory takes it");
            let packed = encoder.finish().expect("memory takes it");
            file.extend([15_u32.to_le_bytes(), u32::try_from(packed.len()).expect("short").to_le_bytes()].concat());
            file.extend(packed);
        } else {
            file.extend(variable);
        }
    };
    let count = u32::try_from(rows).expect("few");
    add(matrix("t_s", count, 1, &column(&|n| n * 0.01)), pack);
    add(matrix("x", count, 1, &column(&|n| (n * 0.1).sin())), pack);
    add(matrix("u", 1, count, &column(&|n| (n * 0.1).cos())), pack);
    if let Some(megabytes) = bomb(random) {
        let zeros = vec![0; (megabytes << 20) as usize];
        add(matrix("bomb", megabytes << 17, 1, &zeros), true);
    }
    file
}

/// An array of doubles as NumPy writes it.
fn npy(rows: u64, values: &[u8]) -> Vec<u8> {
    let mut head = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({rows},), }}");
    // Magic bytes, version and length take ten bytes; the head ends with a line break at a multiple of 64.
    head.extend(std::iter::repeat_n(' ', 63 - (head.len() + 10) % 64));
    head.push('\n');
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend(u16::try_from(head.len()).expect("short").to_le_bytes());
    file.extend(head.as_bytes());
    file.extend(values);
    file
}

/// An archive of arrays of time, motion and force, packed or not, some with zeros without end or with lengths that lie.
fn npz(random: &mut Random) -> Vec<u8> {
    let rows = 20 + random.below(200);
    let column = |of: &dyn Fn(f64) -> f64| (0..rows).flat_map(|n| of(n as f64).to_le_bytes()).collect::<Vec<u8>>();
    let pack = random.below(2) == 0;
    let mut entries = vec![
        ("t_s", npy(rows, &column(&|n| n * 0.01))),
        ("x", npy(rows, &column(&|n| (n * 0.1).sin()))),
        ("u", npy(rows, &column(&|n| (n * 0.1).cos()))),
    ];
    if let Some(megabytes) = bomb(random) {
        entries.push(("bomb", npy(u64::from(megabytes) << 17, &vec![0; (megabytes << 20) as usize])));
    }
    let (mut file, mut directory) = (Vec::new(), Vec::new());
    for (name, content) in &entries {
        let pack = pack || *name == "bomb";
        let mut crc = flate2::Crc::new();
        crc.update(content);
        let packed = if pack {
            let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
            encoder.write_all(content).expect("memory takes it");
            encoder.finish().expect("memory takes it")
        } else {
            content.clone()
        };
        let length = |bytes: &[u8]| u32::try_from(bytes.len()).expect("short").to_le_bytes();
        let says = if random.below(40) == 0 { 100_u32.to_le_bytes() } else { length(content) };
        let name = format!("{name}.npy");
        let short = |value: u16| value.to_le_bytes();
        // Version, flags, method, time, date; check sum, lengths; lengths of the name and of what follows it.
        let mut common = [short(20), short(0), short(if pack { 8 } else { 0 }), short(0), short(0)].concat();
        common.extend([crc.sum().to_le_bytes(), length(&packed), says].concat());
        common.extend([short(u16::try_from(name.len()).expect("short")), short(0)].concat());
        let start = length(&file);
        file.extend(b"PK\x03\x04");
        file.extend(&common);
        file.extend(name.as_bytes());
        file.extend(packed);
        directory.extend(b"PK\x01\x02");
        directory.extend(short(20));
        directory.extend(common);
        // No remark, one disk, no attributes, and where the entry begins.
        directory.extend([0; 10]);
        directory.extend(start);
        directory.extend(name.as_bytes());
    }
    let count = u16::try_from(entries.len()).expect("few").to_le_bytes();
    let start = u32::try_from(file.len()).expect("short").to_le_bytes();
    let size = u32::try_from(directory.len()).expect("short").to_le_bytes();
    file.extend(directory);
    file.extend(b"PK\x05\x06\x00\x00\x00\x00");
    file.extend([count, count].concat());
    file.extend([size, start].concat());
    file.extend([0; 2]);
    file
}

/// An MCAP file of a chunk that unpacks to zeros, fewer or more than it says.
fn mcap(random: &mut Random) -> Vec<u8> {
    let size = random.of(&[1_usize, 10, 300]) << 20;
    let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
    encoder.write_all(&vec![0; size]).expect("memory takes it");
    let packed = encoder.finish().expect("memory takes it");
    let says = *random.of(&[size as u64, 100, u64::MAX]);
    let mut chunk = vec![0; 16];
    chunk.extend(says.to_le_bytes());
    chunk.extend([0; 4]);
    chunk.extend(3_u32.to_le_bytes());
    chunk.extend(b"lz4");
    chunk.extend((packed.len() as u64).to_le_bytes());
    chunk.extend(packed);
    let mut file = b"\x89MCAP0\r\n".to_vec();
    file.push(6);
    file.extend((chunk.len() as u64).to_le_bytes());
    file.extend(chunk);
    file
}

/// A file of another tool or of our own, one in three of them bent.
pub(super) fn text(random: &mut Random) -> String {
    let own = random.below(400);
    let bytes = match own {
        0 => mcap(random),
        1..=80 => mat(random),
        81..=160 => npz(random),
        _ => random.of::<Vec<u8>>(files()).clone(),
    };
    let bytes = if random.below(3) == 0 { bent(bytes, random) } else { bytes };
    let mut text = String::with_capacity(2 * bytes.len());
    for byte in bytes {
        text.extend([byte >> 4, byte & 15].map(|digit| char::from(b"0123456789abcdef"[usize::from(digit)])));
    }
    text
}

/// The columns of the names that the files of other tools have, as a recording.
pub(super) fn recording(text: &str) -> Verdict {
    static MODEL: OnceLock<DeclaredModel> = OnceLock::new();
    let model = MODEL.get_or_init(|| {
        let text = "model A { coordinate x [m]; input u [N]; parameter m [kg]; m*ddot(x) = u; }";
        DeclaredModel::parse("A", text).expect("a model")
    });
    let digits: Vec<u8> = text.bytes().filter_map(|letter| char::from(letter).to_digit(16)?.try_into().ok()).collect();
    let bytes: Vec<u8> = digits.chunks_exact(2).map(|pair| pair[0] << 4 | pair[1]).collect();
    let names = if bytes.starts_with(b"\x89MCAP") || bytes.starts_with(b"SQLite") {
        &[("x", "position.slider"), ("u", "effort.slider")][..]
    } else if bytes.starts_with(b"WPILOG") {
        &[("x", "/slider/x"), ("u", "/slider/u")][..]
    } else {
        &[][..]
    };
    let map = names.iter().map(|(own, column)| ((*own).to_owned(), (*column).to_owned())).collect();
    let settings = ReadingSettings { map, ..ReadingSettings::default() };
    match Recording::read(&bytes[..], "log", model.evaluated(), &settings) {
        Ok(found) => {
            let channels = found.segments.iter().flat_map(|segment| &segment.channels);
            assert!(channels.flatten().all(|value| value.is_finite()), "a sample that is no number");
            Verdict::Answered
        }
        Err(fault) => refused(&fault),
    }
}
