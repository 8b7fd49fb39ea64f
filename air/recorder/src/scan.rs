//! Finds what is whole in an MCAP file, whatever has become of the rest: each chunk whose lengths fit and whose checksum
//! is right, and where something between them is not. A damaged length leads nowhere: chunks are looked for by their
//! header, not by the length of what lies before them. Nothing larger than the file and [`CHUNK_LIMIT`] is allocated.

use std::collections::BTreeMap;
use std::ops::Range;

/// A chunk holds at most so much unpacked; ours end at 1 MB and the record that exceeds it.
pub(crate) const CHUNK_LIMIT: usize = 64 << 20;

/// Bytes before a record's content: its opcode and length.
const HEADER: usize = 9;
/// The opcode of a message.
const MESSAGE: u8 = 0x05;
/// Of a channel.
const CHANNEL: u8 = 0x04;
/// Of a chunk.
const CHUNK: u8 = 0x06;
/// The last opcode that the format knows.
const LAST_OPCODE: u8 = 0x0F;
/// From a chunk record's begin to its compression's name: opcode, length, times, size, checksum.
const TO_NAME: usize = HEADER + 28;
/// The footer record and the magic bytes.
const FOOTER: usize = HEADER + 20 + mcap::MAGIC.len();
/// What a footer begins with: its opcode and length.
const FOOTER_HEADER: [u8; HEADER] = [0x02, 20, 0, 0, 0, 0, 0, 0, 0];
/// The compression's name as it stands in a chunk: the string's length and the string.
const NAMES: [&[u8]; 2] = [b"\x04\0\0\0zstd", b"\0\0\0\0"];

/// A part of the file that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// From the end of what is whole before it to the begin of what is whole after it.
    pub bytes: Range<usize>,
    /// The last record's time before it; none: it is at the log's begin.
    pub after_ns: Option<u64>,
    /// The first record's time after it; none: nothing whole follows.
    pub before_ns: Option<u64>,
}

/// A whole chunk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Chunk {
    packed: Range<usize>,
    zstd: bool,
    size: usize,
    crc: u32,
    end: usize,
    times: (u64, u64),
}

/// What a file holds.
#[derive(Debug, Default)]
pub(crate) struct Contents {
    pub chunks: Vec<Chunk>,
    pub damage: Vec<Damage>,
    /// Topics by channel.
    pub channels: BTreeMap<u16, String>,
    /// The footer is there.
    pub closed: bool,
}

/// Walks the file, which begins with the magic bytes.
pub(crate) fn scan(file: &[u8]) -> Contents {
    let mut found = Contents { closed: ends_with_footer(file), ..Contents::default() };
    let (mut whole_to, mut from, mut broken) = (mcap::MAGIC.len(), mcap::MAGIC.len(), false);
    while let Some((at, chunk)) = next_chunk(file, from) {
        let Some(data) = unpack(file, &chunk) else {
            (from, broken) = (at + 1, true);
            continue;
        };
        for record in records(&data) {
            learn_channel(record, &mut found.channels);
        }
        if broken || !is_chain(&file[whole_to..at], &mut found.channels) {
            let after_ns = found.chunks.last().map(|chunk| chunk.times.1);
            found.damage.push(Damage { bytes: whole_to..at, after_ns, before_ns: Some(chunk.times.0) });
        }
        (whole_to, from, broken) = (chunk.end, chunk.end, false);
        found.chunks.push(chunk);
    }
    // What looks like an end may lie within the last chunk.
    found.closed &= whole_to + FOOTER <= file.len();
    // What was cut off ends within a record; a damaged file has its end, or a whole chunk's length that is wrong.
    let rest = if found.closed { whole_to..file.len() - mcap::MAGIC.len() } else { whole_to..file.len() };
    let whole = is_chain(&file[rest.clone()], &mut found.channels);
    if broken || (found.closed && !whole) {
        let after_ns = found.chunks.last().map(|chunk| chunk.times.1);
        found.damage.push(Damage { bytes: rest, after_ns, before_ns: None });
    }
    found
}

fn ends_with_footer(file: &[u8]) -> bool {
    file.ends_with(mcap::MAGIC) && file.len() > FOOTER && file[file.len() - FOOTER..].starts_with(&FOOTER_HEADER)
}

/// The next place at or after `from` that looks like a chunk from its opcode to its last length.
fn next_chunk(file: &[u8], from: usize) -> Option<(usize, Chunk)> {
    let last = file.len().checked_sub(TO_NAME + 12)?;
    (from..=last).find_map(|at| Some((at, chunk_at(file, at)?)))
}

fn chunk_at(file: &[u8], at: usize) -> Option<Chunk> {
    if *file.get(at)? != CHUNK {
        return None;
    }
    let name = file.get(at + TO_NAME..)?;
    let (index, name) = NAMES.iter().enumerate().find(|(_, text)| name.starts_with(text))?;
    let begin = at + TO_NAME + name.len() + 8;
    let length = usize::try_from(u64_at(file, at + 1)?).ok()?;
    let packed = usize::try_from(u64_at(file, begin - 8)?).ok()?;
    let size = usize::try_from(u64_at(file, at + HEADER + 16)?).ok()?;
    let end = begin.checked_add(packed)?;
    let fits = end <= file.len() && at.checked_add(HEADER)?.checked_add(length)? == end && size <= CHUNK_LIMIT;
    let (zstd, crc) = (index == 0, u32_at(file, at + HEADER + 24)?);
    let times = (u64_at(file, at + HEADER)?, u64_at(file, at + HEADER + 8)?);
    (fits && times.0 <= times.1 && (zstd || packed == size)).then_some(Chunk {
        packed: begin..end,
        zstd,
        size,
        crc,
        end,
        times,
    })
}

/// A chunk's records; none: they are not what the checksum says, or not records.
pub(crate) fn unpack(file: &[u8], chunk: &Chunk) -> Option<Vec<u8>> {
    let packed = file.get(chunk.packed.clone())?;
    let data = if chunk.zstd { zstd::bulk::decompress(packed, chunk.size).ok()? } else { packed.to_vec() };
    let whole = data.len() == chunk.size && (chunk.crc == 0 || crc32fast::hash(&data) == chunk.crc);
    (whole && records(&data).map(|record| HEADER + record.1.len()).sum::<usize>() == data.len()).then_some(data)
}

/// The records that `data` begins with: opcode and content. Ends at the first that does not fit.
fn records(mut data: &[u8]) -> impl Iterator<Item = (u8, &[u8])> {
    std::iter::from_fn(move || {
        let length = usize::try_from(u64_at(data, 1)?).ok()?;
        let opcode = data[0];
        let content = data.get(HEADER..HEADER.checked_add(length)?)?;
        data = &data[HEADER + length..];
        Some((opcode, content))
    })
}

/// The messages of a chunk's records: channel, time, payload.
pub(crate) fn messages(data: &[u8]) -> impl Iterator<Item = (u16, u64, &[u8])> {
    records(data)
        .filter(|(opcode, _)| *opcode == MESSAGE)
        .filter_map(|(_, content)| Some((u16_at(content, 0)?, u64_at(content, 6)?, content.get(22..)?)))
}

/// `bytes` are records from begin to end, none of them a chunk; their channels are learnt.
fn is_chain(bytes: &[u8], channels: &mut BTreeMap<u16, String>) -> bool {
    let mut length = 0;
    let known = records(bytes).all(|record| {
        learn_channel(record, channels);
        length += HEADER + record.1.len();
        (1..=LAST_OPCODE).contains(&record.0) && record.0 != CHUNK
    });
    known && length == bytes.len()
}

fn learn_channel((opcode, content): (u8, &[u8]), channels: &mut BTreeMap<u16, String>) {
    let topic = || {
        let length = u32_at(content, 4)? as usize;
        let topic = std::str::from_utf8(content.get(8..8_usize.checked_add(length)?)?).ok()?;
        Some((u16_at(content, 0)?, topic.to_owned()))
    };
    if opcode == CHANNEL
        && let Some((id, topic)) = topic()
    {
        channels.entry(id).or_insert(topic);
    }
}

fn bytes_at<const N: usize>(data: &[u8], at: usize) -> Option<[u8; N]> {
    data.get(at..at.checked_add(N)?)?.try_into().ok()
}

fn u16_at(data: &[u8], at: usize) -> Option<u16> {
    bytes_at(data, at).map(u16::from_le_bytes)
}

fn u32_at(data: &[u8], at: usize) -> Option<u32> {
    bytes_at(data, at).map(u32::from_le_bytes)
}

fn u64_at(data: &[u8], at: usize) -> Option<u64> {
    bytes_at(data, at).map(u64::from_le_bytes)
}
