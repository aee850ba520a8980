//! Triangle meshes and strands from PLY files, ASCII or binary of either byte order.
//!
//! The parser is our own: of the whole format a solid needs the coordinates of `vertex` and the list of `face`, strands as
//! the ADONIS simulator writes them the vertices' `segment` and `actual`; everything else declared in the header is stepped over. Nothing is allocated on the word of a count: elements are read as long as
//! there are bytes.

use std::path::Path;

use crate::bytes::read_file;
use crate::error::{Error, Result};
use crate::groom::{Groom, LengthUnit};
use crate::mesh::{TriMesh, Weld};

/// Reads a PLY file; polygons become fans.
///
/// # Errors
/// When the file cannot be read or parsed, or does not hold a usable mesh.
pub fn read_ply(path: &Path, unit: LengthUnit) -> Result<TriMesh> {
    parse_ply(path, &read_file(path)?, unit)
}

/// [`read_ply`] from bytes; `path` serves the error texts.
///
/// # Errors
/// As [`read_ply`].
pub fn parse_ply(path: &Path, bytes: &[u8], unit: LengthUnit) -> Result<TriMesh> {
    let bad = |reason: String| Error::BadMesh { path: path.to_path_buf(), reason };
    let (header, body) = Header::parse(bytes).map_err(bad)?;
    let mut source = Source { form: header.form, rest: &bytes[body..], pending: &[] };
    let mut positions: Vec<[f32; 3]> = Vec::new();
    let mut weld = Weld::default();
    let mut list: Vec<f64> = Vec::new();
    let mut face: Vec<[f32; 3]> = Vec::new();
    for element in &header.elements {
        let at = |names: &[&str]| element.properties.iter().position(|p| names.contains(&p.name.as_str()));
        let is_vertex = element.name == "vertex";
        let xyz = match (is_vertex, [at(&["x"]), at(&["y"]), at(&["z"])]) {
            (true, [Some(x), Some(y), Some(z)]) => [x, y, z],
            (true, _) => return Err(bad("its vertices have no x, y and z".into())),
            _ => [usize::MAX; 3],
        };
        let corners = if element.name == "face" { at(&["vertex_indices", "vertex_index"]) } else { None };
        if element.properties.is_empty() {
            continue;
        }
        for n in 0..element.count {
            let cut = || bad(format!("{} {n} of {} is missing or no number", element.name, element.count));
            let mut position = [0.0; 3];
            for (k, property) in element.properties.iter().enumerate() {
                source.read(property, &mut list).ok_or_else(cut)?;
                if let Some(axis) = xyz.iter().position(|&p| p == k) {
                    position[axis] = *list.first().ok_or_else(cut)? as f32;
                }
                if corners == Some(k) {
                    face.clear();
                    for &index in &list {
                        let known = index >= 0.0 && index < positions.len() as f64;
                        let p = known.then(|| positions[index as usize]).ok_or_else(|| {
                            bad(format!("face {n} names vertex {index}, but there are {} before it", positions.len()))
                        })?;
                        face.push(p);
                    }
                    for k in 2..face.len() {
                        weld.add([face[0], face[k - 1], face[k]]);
                    }
                }
            }
            if is_vertex {
                positions.push(position);
            }
        }
    }
    weld.finish(path, unit)
}

/// Reads the strands of a PLY file: its vertices, root first, those of one `segment` one strand after the other. Vertices whose
/// `actual` is zero only pad a strand's ends and are left out.
///
/// # Errors
/// When the file cannot be read or parsed, its vertices have no `segment`, or a coordinate is not finite.
pub fn read_ply_strands(path: &Path, unit: LengthUnit) -> Result<Groom> {
    parse_ply_strands(path, &read_file(path)?, unit)
}

/// [`read_ply_strands`] from bytes; `path` serves the error texts.
///
/// # Errors
/// As [`read_ply_strands`].
pub fn parse_ply_strands(path: &Path, bytes: &[u8], unit: LengthUnit) -> Result<Groom> {
    let bad = |reason: String| Error::BadMesh { path: path.to_path_buf(), reason };
    let (header, body) = Header::parse(bytes).map_err(bad)?;
    let mut source = Source { form: header.form, rest: &bytes[body..], pending: &[] };
    let Some(first) = header.elements.first().filter(|e| e.name == "vertex") else {
        return Err(bad("it does not begin with vertices".into()));
    };
    let at = |name: &str| first.properties.iter().position(|p| p.name == name && p.length.is_none());
    let [Some(x), Some(y), Some(z), Some(segment)] = ["x", "y", "z", "segment"].map(at) else {
        return Err(bad("its vertices have no x, y, z and segment: it holds no strands".into()));
    };
    let actual = at("actual");
    let mut groom = Groom::default();
    let mut current = None;
    let (mut list, mut row) = (Vec::new(), vec![0.0; first.properties.len()]);
    for n in 0..first.count {
        let cut = || bad(format!("vertex {n} of {} is missing or no number", first.count));
        for (value, property) in row.iter_mut().zip(&first.properties) {
            source.read(property, &mut list).ok_or_else(cut)?;
            *value = list.first().copied().unwrap_or_default();
        }
        if actual.is_some_and(|actual| row[actual] == 0.0) {
            continue;
        }
        let point = [x, y, z].map(|axis| (row[axis] * unit.cm_per_unit()) as f32);
        if point.iter().any(|x| !x.is_finite()) {
            return Err(bad(format!("vertex {n} is not finite")));
        }
        if current != Some(row[segment]) {
            current = Some(row[segment]);
            groom.point_counts.push(0);
        }
        if let Some(count) = groom.point_counts.last_mut() {
            *count += 1;
        }
        groom.points.push(point);
    }
    Ok(groom)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Ascii,
    Little,
    Big,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number in little-endian bytes, the last [`Self::bytes`] of which are its own.
    fn value(self, b: [u8; 8]) -> f64 {
        let four = [b[0], b[1], b[2], b[3]];
        match self {
            Self::I8 => f64::from(b[0] as i8),
            Self::U8 => f64::from(b[0]),
            Self::I16 => f64::from(i16::from_le_bytes([b[0], b[1]])),
            Self::U16 => f64::from(u16::from_le_bytes([b[0], b[1]])),
            Self::I32 => f64::from(i32::from_le_bytes(four)),
            Self::U32 => f64::from(u32::from_le_bytes(four)),
            Self::F32 => f64::from(f32::from_le_bytes(four)),
            Self::F64 => f64::from_le_bytes(b),
        }
    }
}

#[derive(Debug)]
struct Property {
    name: String,
    kind: Scalar,
    /// Type of the length of a list.
    length: Option<Scalar>,
}

#[derive(Debug)]
struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

#[derive(Debug)]
struct Header {
    form: Form,
    elements: Vec<Element>,
}

impl Header {
    /// The header and where the data begin.
    fn parse(bytes: &[u8]) -> Result<(Self, usize), String> {
        let mut form = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut at = 0;
        for n in 0.. {
            let Some(length) = bytes[at..].iter().position(|&b| b == b'\n') else {
                return Err("its header does not end".into());
            };
            let line = String::from_utf8_lossy(&bytes[at..at + length]);
            at += length + 1;
            let words: Vec<&str> = line.split_whitespace().collect();
            let unknown = || format!("line {} of its header says {line:?}", n + 1);
            if n == 0 && words != ["ply"] {
                return Err("it does not begin with \"ply\"".into());
            }
            match words[..] {
                ["ply"] if n == 0 => {}
                [] | ["comment" | "obj_info", ..] => {}
                ["format", name, _] => {
                    form = Some(match name {
                        "ascii" => Form::Ascii,
                        "binary_little_endian" => Form::Little,
                        "binary_big_endian" => Form::Big,
                        _ => return Err(unknown()),
                    });
                }
                ["element", name, count] => {
                    let count = count.parse().map_err(|_| unknown())?;
                    elements.push(Element { name: name.into(), count, properties: Vec::new() });
                }
                ["property", "list", length, kind, name] => {
                    let length = Some(Scalar::named(length).ok_or_else(unknown)?);
                    let kind = Scalar::named(kind).ok_or_else(unknown)?;
                    let element = elements.last_mut().ok_or_else(unknown)?;
                    element.properties.push(Property { name: name.into(), kind, length });
                }
                ["property", kind, name] => {
                    let kind = Scalar::named(kind).ok_or_else(unknown)?;
                    let element = elements.last_mut().ok_or_else(unknown)?;
                    element.properties.push(Property { name: name.into(), kind, length: None });
                }
                ["end_header"] => break,
                _ => return Err(unknown()),
            }
        }
        let form = form.ok_or("its header states no format")?;
        Ok((Self { form, elements }, at))
    }
}

/// What is left of the data.
struct Source<'a> {
    form: Form,
    rest: &'a [u8],
    /// Of ASCII, what is left of the present line.
    pending: &'a [u8],
}

impl Source<'_> {
    /// The numbers of one property of the next element into `out`; none where there are no more.
    fn read(&mut self, property: &Property, out: &mut Vec<f64>) -> Option<()> {
        out.clear();
        let n = match property.length {
            Some(length) => self.number(length)?,
            None => 1.0,
        };
        let n = if n >= 0.0 && n.fract() == 0.0 { n as u64 } else { return None };
        for _ in 0..n {
            out.push(self.number(property.kind)?);
        }
        Some(())
    }

    fn number(&mut self, kind: Scalar) -> Option<f64> {
        if self.form == Form::Ascii {
            return self.word().and_then(|w| std::str::from_utf8(w).ok()).and_then(|w| w.parse().ok());
        }
        let (own, rest) = self.rest.split_at_checked(kind.bytes())?;
        self.rest = rest;
        let mut bytes = [0; 8];
        bytes[..own.len()].copy_from_slice(own);
        if self.form == Form::Big {
            bytes[..own.len()].reverse();
        }
        Some(kind.value(bytes))
    }

    fn word(&mut self) -> Option<&[u8]> {
        loop {
            let start = self.pending.iter().position(|b| !b.is_ascii_whitespace());
            if let Some(start) = start {
                let from = &self.pending[start..];
                let end = from.iter().position(u8::is_ascii_whitespace).unwrap_or(from.len());
                self.pending = &from[end..];
                return Some(&from[..end]);
            }
            if self.rest.is_empty() {
                return None;
            }
            let end = self.rest.iter().position(|&b| b == b'\n').map_or(self.rest.len(), |n| n + 1);
            (self.pending, self.rest) = self.rest.split_at(end);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "element vertex 4\nproperty float x\nproperty double y\nproperty float z\nproperty uchar red\n\
                          element edge 1\nproperty int a\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n";

    fn ascii() -> Vec<u8> {
        format!("ply\r\nformat ascii 1.0\ncomment made by hand\n{HEADER}0 0 0 9\n1 0 0 9\n1 1 0 9\n\n0 1 0.5 9\n7\n4 0 1 2 3\n3 0 2 1\n")
            .into_bytes()
    }

    fn binary(big: bool) -> Vec<u8> {
        let name = if big { "big" } else { "little" };
        let mut out = format!("ply\nformat binary_{name}_endian 1.0\n{HEADER}").into_bytes();
        let mut put = |bytes: &[u8]| {
            let mut bytes = bytes.to_vec();
            if big {
                bytes.reverse();
            }
            out.extend(bytes);
        };
        for [x, y, z] in [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.5f32]] {
            put(&x.to_le_bytes());
            put(&f64::from(y).to_le_bytes());
            put(&z.to_le_bytes());
            put(&[9]);
        }
        put(&7i32.to_le_bytes());
        for face in [&[0, 1, 2, 3][..], &[0, 2, 1]] {
            put(&[face.len() as u8]);
            face.iter().for_each(|v: &i32| put(&v.to_le_bytes()));
        }
        out
    }

    #[test]
    fn ascii_and_both_byte_orders_hold_the_same_mesh() {
        let read = |bytes: &[u8]| parse_ply(Path::new("a.ply"), bytes, LengthUnit::Cm).unwrap();
        let mesh = read(&ascii());
        assert_eq!(mesh.vertices, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.5]]);
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 2, 1]]);
        assert_eq!(read(&binary(false)), mesh);
        assert_eq!(read(&binary(true)), mesh);
    }

    const STRANDS: &str = "ply\nformat ascii 1.0\ncomment created by ADONIS\nelement vertex 7\nproperty float x\nproperty float y\n\
                           property float z\nproperty float theta\nproperty int segment\nproperty int actual\nelement face 0\n\
                           property list int int vertex_indices\nend_header \n\
                           9 9 9 0 0 0\n0 0 0 0 0 1\n0 1 0 0 0 1\n1 0 0 0 3 1\n1 1 0 0 3 1\n1 2 0 0 3 1\n9 9 9 0 3 0\n";

    #[test]
    fn strands_are_told_apart_by_segment_and_their_padding_left_out() {
        let read = |text: &str| parse_ply_strands(Path::new("a.ply"), text.as_bytes(), LengthUnit::Mm);
        let groom = read(STRANDS).unwrap();
        assert_eq!(groom.point_counts, [2, 3]);
        assert_eq!(groom.strand(1), [[0.1, 0.0, 0.0], [0.1, 0.1, 0.0], [0.1, 0.2, 0.0]]);
        for n in 0..STRANDS.len() - 12 {
            assert!(read(&STRANDS[..n]).is_err(), "cut at {n}");
        }
        assert!(read(&STRANDS.replace("segment", "part")).unwrap_err().to_string().contains("no strands"));
        assert!(read(&STRANDS.replace("1 2 0 0 3 1", "1 nan 0 0 3 1")).unwrap_err().to_string().contains("vertex 5"));
    }

    #[test]
    fn files_cut_short_or_changed_are_refused_and_never_hang() {
        for bytes in [ascii(), binary(false), binary(true)] {
            for n in 0..bytes.len() - 1 {
                // The last line of the text may lose its end of line, or a digit of its last number.
                let shorter = parse_ply(Path::new("a.ply"), &bytes[..n], LengthUnit::Cm);
                assert!(shorter.is_err() || n + 2 > bytes.len(), "cut at {n}");
                let mut changed = bytes.clone();
                changed[n] ^= 0x15;
                let _ = parse_ply(Path::new("a.ply"), &changed, LengthUnit::Cm);
            }
        }
        // A count that no file could hold is not believed.
        let huge = String::from_utf8(ascii()).unwrap().replace("vertex 4", "vertex 4000000000000");
        assert!(parse_ply(Path::new("a.ply"), huge.as_bytes(), LengthUnit::Cm).is_err());
    }
}
