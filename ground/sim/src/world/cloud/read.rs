//! Points out of files.

use super::{CloudError, Point};
use pcd_rs::DynReader;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// The points of a `.ply` or `.pcd` file; those with a coordinate that is no number are left to the caller.
pub(super) fn points(path: &Path) -> Result<Vec<Point>, CloudError> {
    let kind = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    let read = match kind.as_deref() {
        Some("ply") => ply(path),
        Some("pcd") => pcd(path),
        _ => return Err(CloudError::Kind(path.to_owned())),
    };
    // Some of the libraries' messages have several lines.
    let line = |cause: String| cause.lines().map(str::trim).filter(|l| !l.is_empty()).collect::<Vec<_>>().join(" ");
    read.map_err(|cause| CloudError::Read { path: path.to_owned(), cause: line(cause) })
}

/// A vertex as it is read.
struct Vertex {
    at: [f64; 3],
    rgb: [Option<u8>; 3],
}

/// A scalar property as a number.
fn number(property: &Property) -> Option<f64> {
    Some(match *property {
        Property::Char(v) => v.into(),
        Property::UChar(v) => v.into(),
        Property::Short(v) => v.into(),
        Property::UShort(v) => v.into(),
        Property::Int(v) => v.into(),
        Property::UInt(v) => v.into(),
        Property::Float(v) => v.into(),
        Property::Double(v) => v,
        _ => return None,
    })
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self { at: [f64::NAN; 3], rgb: [None; 3] }
    }

    fn set_property(&mut self, key: &str, property: Property) -> PropertyAccessResult {
        let place = |names: [&str; 3]| names.iter().position(|name| *name == key);
        match (place(["x", "y", "z"]), place(["red", "green", "blue"]), &property) {
            (Some(axis), _, value) => match number(value) {
                Some(value) => self.at[axis] = value,
                None => return PropertyAccessResult::UnsupportedType,
            },
            (None, Some(channel), Property::UChar(level)) => self.rgb[channel] = Some(*level),
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

fn ply(path: &Path) -> Result<Vec<Point>, String> {
    let file = File::open(path).map_err(|e| e.to_string())?;
    let bytes = file.metadata().map_err(|e| e.to_string())?.len();
    let mut file = Reader::new(BufReader::new(file));
    let parser = Parser::<Vertex>::new();
    let header = parser.read_header(&mut file).map_err(|e| e.to_string())?;
    for (name, element) in &header.elements {
        // One of an element without properties takes no bytes: the library would make as many as it is told to.
        if element.count as u64 > bytes {
            return Err(format!("its header promises {} of {name:?}, and the file has {bytes} bytes", element.count));
        }
        let read = parser.read_payload_for_element(&mut file, element, &header).map_err(|e| e.to_string())?;
        if name == "vertex" {
            let colour = |v: &Vertex| Some([v.rgb[0]?, v.rgb[1]?, v.rgb[2]?]);
            return Ok(read.iter().map(|v| Point { at: v.at, rgb: colour(v) }).collect());
        }
    }
    Err("it has no element \"vertex\"".to_owned())
}

/// What the header of a `.pcd` says of its data.
#[derive(Default)]
struct Promise {
    sizes: Vec<u128>,
    counts: Vec<u128>,
    points: u128,
    kind: String,
}

impl Promise {
    /// Reads the header; gives the data after it too.
    fn read(mut rest: &[u8]) -> Option<(Self, &[u8])> {
        let mut promise = Self::default();
        loop {
            let end = rest.iter().position(|byte| *byte == b'\n')?;
            let line = String::from_utf8_lossy(&rest[..end]).into_owned();
            rest = &rest[end + 1..];
            // As the library reads it: without comments, keys in any case.
            let mut words = line.split('#').next().unwrap_or_default().split_ascii_whitespace();
            let key = words.next().map(str::to_uppercase);
            let mut numbers = words.clone().map(|word| word.parse::<u64>().map_or(0, u128::from));
            match key.as_deref() {
                Some("SIZE") => promise.sizes = numbers.collect(),
                // The library takes none as one.
                Some("COUNT") => promise.counts = numbers.map(|count| count.max(1)).collect(),
                Some("POINTS") => promise.points = numbers.next().unwrap_or(0),
                Some("DATA") => {
                    words.next().unwrap_or_default().clone_into(&mut promise.kind);
                    return Some((promise, rest));
                }
                _ => {}
            }
        }
    }

    /// Bytes of all points, as they are in memory.
    fn bytes(&self) -> u128 {
        let counts = self.counts.iter().chain(std::iter::repeat(&1));
        let fields = counts.zip(&self.sizes).map(|(count, size)| count.saturating_mul(*size));
        fields.fold(0, u128::saturating_add).saturating_mul(self.points)
    }

    /// Values of one point.
    fn values(&self) -> u128 {
        self.counts.iter().fold(0, |sum, count| sum.saturating_add(*count))
    }
}

/// The header of a `.pcd` promises no more than the file holds: the library believes it, and would panic.
fn holds_what_it_promises(file: &[u8]) -> Result<(), String> {
    let (promise, data) = Promise::read(file).ok_or("its header has no end")?;
    if promise.sizes.is_empty() {
        return Err("its header says no SIZE".to_owned());
    }
    let word = |at: usize| data.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]).into());
    let held = data.len() as u128;
    let (promised, held) = match promise.kind.as_str() {
        "binary" => (promise.bytes(), held),
        "binary_compressed" => match (word(0), word(4)) {
            (Some(packed), Some(_)) if packed > held => (packed, held),
            (Some(_), Some(unpacked)) => (promise.bytes(), unpacked),
            _ => return Err("it is cut off".to_owned()),
        },
        _ => (promise.values(), held),
    };
    if promised > held { Err(format!("its header promises {promised} bytes, and there are {held}")) } else { Ok(()) }
}

fn pcd(path: &Path) -> Result<Vec<Point>, String> {
    let file = std::fs::read(path).map_err(|e| e.to_string())?;
    holds_what_it_promises(&file)?;
    let reader = DynReader::from_bytes(&file).map_err(|e| e.to_string())?;
    let names: Vec<String> =
        reader.meta().field_defs.iter().filter(|f| !f.is_padding()).map(|f| f.name.to_lowercase()).collect();
    let column = |name: &str| names.iter().position(|n| n == name);
    let (Some(x), Some(y), Some(z)) = (column("x"), column("y"), column("z")) else {
        return Err(format!("it has no fields x, y, z (only {})", names.join(", ")));
    };
    let rgb = column("rgb").or(column("rgba"));
    reader
        .map(|record| {
            let fields = record.map_err(|e| e.to_string())?.0;
            let value = |index: usize| {
                let field = fields.get(index)?;
                field.to_value::<f32>().map(f64::from).or(field.to_value::<f64>())
            };
            let at = [x, y, z].map(|index| value(index).unwrap_or(f64::NAN));
            let packed = rgb
                .and_then(|i| fields.get(i))
                .and_then(|field| field.to_value::<f32>().map(f32::to_bits).or(field.to_value::<u32>()));
            let rgb = packed.map(|bits| [(bits >> 16) as u8, (bits >> 8) as u8, bits as u8]);
            Ok(Point { at, rgb })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const POINTS: [[f32; 3]; 3] = [[1.5, -2.0, 0.25], [0.0, 3.0, 1.0], [7.0, 8.0, 9.0]];

    fn read(name: &str, bytes: &[u8]) -> Result<Vec<Point>, CloudError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        points(&path)
    }

    fn places(points: &[Point]) -> Vec<[f32; 3]> {
        points.iter().map(|p| p.at.map(|c| c as f32)).collect()
    }

    #[test]
    fn a_ply_whose_header_promises_more_than_the_file_can_hold_is_refused() {
        for properties in ["", "property float x\n"] {
            let header = "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\n";
            let file = format!("{header}{properties}end_header\n");
            let message = read("cloud.ply", file.as_bytes()).unwrap_err().to_string();
            assert!(message.contains("promises 4000000000 of \"vertex\""), "{message}");
        }
    }

    #[test]
    fn ascii_and_binary_ply_with_and_without_colour_are_read() {
        let ascii = "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 3\nproperty double x\n\
                     property double y\nproperty double z\nproperty uchar red\nproperty uchar green\n\
                     property uchar blue\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n\
                     1.5 -2 0.25 10 20 30\n0 3 1 1 2 3\n7 8 9 4 5 6\n";
        let points = read("a.ply", ascii.as_bytes()).unwrap();
        assert_eq!((places(&points), points[0].rgb), (POINTS.to_vec(), Some([10, 20, 30])));
        let mut binary = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n\
                           property float y\nproperty float z\nend_header\n"
            .to_vec();
        binary.extend(POINTS.iter().flatten().flat_map(|c| c.to_le_bytes()));
        let points = read("b.PLY", &binary).unwrap();
        assert_eq!((places(&points), points[0].rgb), (POINTS.to_vec(), None));
    }

    #[test]
    fn ascii_and_binary_pcd_with_packed_colour_are_read() {
        let header = |data: &str| {
            format!(
                "VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 3\nHEIGHT 1\n\
                 VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\nDATA {data}\n"
            )
        };
        let ascii = header("ascii") + "1.5 -2 0.25 660510\n0 3 1 1\n7 8 9 2\n";
        let points = read("a.pcd", ascii.as_bytes()).unwrap();
        assert_eq!((places(&points), points[0].rgb), (POINTS.to_vec(), Some([10, 20, 30])));
        let mut binary = header("binary").into_bytes();
        for point in POINTS {
            binary.extend(point.iter().flat_map(|c| c.to_le_bytes()).chain(660_510u32.to_le_bytes()));
        }
        let points = read("b.pcd", &binary).unwrap();
        assert_eq!((places(&points), points[2].rgb), (POINTS.to_vec(), Some([10, 20, 30])));
    }

    #[test]
    fn a_pcd_that_promises_more_than_it_holds_is_one_line() {
        let header = |count: u64, points: u64, data: &str| {
            format!(
                "VERSION 0.7\nFIELDS x y z _\nSIZE 4 4 4 1\nTYPE F F F U\nCOUNT 1 1 1 {count}\nWIDTH {points}\n\
                 HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
            )
        };
        let packed = [&[2, 0, 0, 0, 1, 0, 0, 0][..], &[0, 7]].concat();
        for (header, data) in [
            (header(1, 3, "binary_compressed"), &packed[..]),
            (header(1, 3, "binary_compressed").replace("COUNT 1 1 1 1", "COUNT 0 0 0 0"), &packed[..]),
            (header(u64::MAX, 3, "binary"), &[0; 64][..]),
            (header(1, u64::MAX, "binary"), &[0; 64][..]),
            (header(u64::MAX, 1, "ascii"), b"1 2 3 4\n"),
        ] {
            for header in [header.replace("SIZE", "Size").replace("POINTS", "points"), header] {
                let commented = header.replace("POINTS 3", "POINTS 3#");
                let message = read("a.pcd", &[commented.as_bytes(), data].concat()).unwrap_err().to_string();
                assert!(message.contains("promises") && message.lines().count() == 1, "{message}");
            }
        }
    }

    #[test]
    fn a_cut_off_or_foreign_file_is_one_line_that_names_it() {
        let cut = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nend_header\n\0\0";
        for (name, bytes) in
            [("cut.ply", &cut[..]), ("foreign.ply", b"hello"), ("foreign.pcd", b"hello\n"), ("e.pcd", b"")]
        {
            let message = read(name, bytes).unwrap_err().to_string();
            assert!(message.contains(name) && message.lines().count() == 1, "{message}");
        }
    }
}
