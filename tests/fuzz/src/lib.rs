//! What fuzz targets share: seeds, ways to damage them, and what is kept of an input that breaks something.
//!
//! A parser refuses random bytes at once. So bolero does not make bytes, it makes edits, and a target gets a seed of its
//! corpus with these edits done. Seeds are the files of `corpus/TARGET`; an input that broke something becomes one.

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Duration;

use bolero::TypeGenerator;

/// How long a target runs where `BOLERO_RANDOM_TEST_TIME_MS` says nothing.
const TEST_TIME: Duration = Duration::from_secs(10);
/// Seeds are cut here, and edits make them little longer: what a parser does with much, it does with this.
const SEED_BYTES: usize = 16_384;
/// Numbers that programs count wrongly with.
const EDGES: [u64; 12] =
    [0, 1, 127, 128, 255, 256, 0x7FFF, 0xFFFF, 0x7FFF_FFFF, 0xFFFF_FFFF, 0x7FFF_FFFF_FFFF_FFFF, 0xFFFF_FFFF_FFFF_FFFF];
/// Words that text is damaged with.
const WORDS: [&str; 16] = [
    "0",
    "-1",
    "1e308",
    "-1e-308",
    "nan",
    "inf",
    "4294967296",
    "18446744073709551615",
    "9223372036854775807",
    "\"",
    "[",
    "]",
    "{",
    "}",
    "\n",
    "\u{0}é",
];

/// One damage. Places are taken modulo the length.
#[derive(Clone, Debug, TypeGenerator)]
pub enum Edit {
    /// A bit is flipped.
    Flip(u16, u8),
    /// A byte is another.
    Set(u16, u8),
    /// An edge number of 2^n bytes, little or big endian.
    Number(u16, u8, u8, bool),
    /// What is between is gone.
    Remove(u16, u8),
    /// Bytes are put in.
    Insert(u16, [u8; 4], u8),
    /// A piece comes again elsewhere.
    Copy(u16, u8, u16),
    /// The rest is gone.
    Cut(u16),
    /// A word is put in.
    Word(u16, u8),
    /// A number in the text becomes another.
    Digits(u16, u8),
    /// Another seed follows.
    Join(u8),
}

/// Which seed, and what happens to it.
#[derive(Clone, Debug, TypeGenerator)]
pub struct Input {
    seed: u8,
    edits: [Edit; 6],
    many: u8,
}

impl Input {
    /// The damaged seed. One in eight is whole.
    #[must_use]
    pub fn bytes(&self, seeds: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = seeds[usize::from(self.seed) % seeds.len()].clone();
        for edit in &self.edits[..usize::from(self.many % 8).min(self.edits.len())] {
            edit.apply(&mut bytes, seeds);
        }
        bytes
    }
}

impl Edit {
    fn apply(&self, bytes: &mut Vec<u8>, seeds: &[Vec<u8>]) {
        let length = bytes.len();
        let place = |at: u16| usize::from(at) % length.max(1);
        let word = |which: u8| WORDS[usize::from(which) % WORDS.len()].bytes();
        match *self {
            Edit::Join(which) => bytes.extend_from_slice(&seeds[usize::from(which) % seeds.len()]),
            Edit::Insert(at, new, count) => {
                let at = place(at);
                bytes.splice(at..at, new.into_iter().take(1 + usize::from(count % 4)));
            }
            Edit::Word(at, which) => {
                let at = place(at);
                bytes.splice(at..at, word(which));
            }
            _ if length == 0 => {}
            Edit::Flip(at, bit) => bytes[place(at)] ^= 1 << (bit % 8),
            Edit::Set(at, value) => bytes[place(at)] = value,
            Edit::Number(at, which, size, big) => {
                let (at, size) = (place(at), 1 << (size % 4));
                let mut value = EDGES[usize::from(which) % EDGES.len()].to_le_bytes();
                if big {
                    value[..size].reverse();
                }
                for (byte, new) in bytes[at..].iter_mut().zip(&value[..size]) {
                    *byte = *new;
                }
            }
            Edit::Remove(at, count) => {
                let at = place(at);
                bytes.drain(at..(at + 1 + usize::from(count)).min(length));
            }
            Edit::Copy(from, count, to) => {
                let from = place(from);
                let piece = bytes[from..(from + 1 + usize::from(count)).min(length)].to_vec();
                let to = place(to);
                bytes.splice(to..to, piece);
            }
            Edit::Cut(at) => bytes.truncate(place(at)),
            Edit::Digits(at, which) => {
                let digit = |b: &u8| b.is_ascii_digit() || b"+-.eE".contains(b);
                let Some(begin) = bytes[place(at)..].iter().position(u8::is_ascii_digit).map(|n| n + place(at)) else {
                    return;
                };
                let end = bytes[begin..].iter().position(|b| !digit(b)).map_or(length, |n| n + begin);
                bytes.splice(begin..end, word(which));
            }
        }
    }
}

/// Runs `test` on seeds of `corpus/TARGET`, each as it is and then damaged, until the time is up. An input that panics is
/// kept in the corpus, as small as bolero could make it; one that ends the process is in `target/tmp/TARGET.last`.
///
/// `test` says for each parser whether it took the bytes. Each must take some seed: damage to what is refused whole shows
/// nothing.
///
/// # Panics
/// With the test, without a seed, or with a parser that takes none.
pub fn run<const PARSERS: usize>(target: &'static str, scratch: &Path, test: impl Fn(&[u8]) -> [bool; PARSERS]) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
    let seeds = seeds(&folder);
    let last = scratch.join(format!("{target}.last"));
    let kept: Mutex<Option<usize>> = Mutex::new(None);
    let once = |bytes: &[u8]| {
        fs::write(&last, bytes).expect("the scratch folder can be written to");
        catch_unwind(AssertUnwindSafe(|| test(bytes))).unwrap_or_else(|panic| {
            let mut kept = kept.lock().expect("nothing panics with it");
            if kept.is_none_or(|length| bytes.len() < length) {
                *kept = Some(bytes.len());
                let path = folder.join(format!("crash-{}", std::process::id()));
                fs::write(&path, bytes).expect("the corpus can be written to");
                eprintln!("kept as {}", path.display());
            }
            resume_unwind(panic)
        })
    };
    let takes: Vec<[bool; PARSERS]> = seeds.iter().map(|seed| once(seed)).collect();
    for parser in 0..PARSERS {
        assert!(takes.iter().any(|taken| taken[parser]), "parser {parser} of {target} refuses every seed");
    }
    let once = AssertUnwindSafe(once);
    let seeds = AssertUnwindSafe(seeds);
    bolero::check!().with_type::<Input>().with_test_time(TEST_TIME).for_each(|input: &Input| {
        once(&input.bytes(&seeds));
    });
}

fn seeds(folder: &Path) -> Vec<Vec<u8>> {
    let listed = fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let mut paths: Vec<PathBuf> = listed.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    let read = |path: &PathBuf| {
        let mut bytes = fs::read(path).expect("a seed can be read");
        bytes.truncate(SEED_BYTES);
        bytes
    };
    let seeds: Vec<Vec<u8>> = paths.iter().map(read).collect();
    assert!(!seeds.is_empty(), "no seed in {}", folder.display());
    seeds
}
