//! Triangle meshes of solids from OBJ, STL and PLY, in centimetres, with equal vertices merged.
//!
//! Merging is by position (files repeat vertices along seams), so that a mesh that is closed in space is closed in its
//! indices; triangles that lose a corner to it have no area and are dropped. Invariant after reading: coordinates finite,
//! indices in range, at least one triangle.

use std::collections::HashMap;
use std::io::{BufWriter, Cursor, Write};
use std::path::Path;

use crate::bytes::read_file;
use crate::envelope::{publish, temporary_path};
use crate::error::{Error, Result};
use crate::groom::{LengthUnit, transform_point};

/// Positions this near, as a share of the largest coordinate, are one vertex: some writers compute a corner anew for each
/// triangle and differ in the last bits of an `f32`.
const MERGE_TOLERANCE: f64 = 1e-6;

/// Triangles over shared vertices.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TriMesh {
    /// Positions (cm).
    pub vertices: Vec<[f32; 3]>,
    /// Vertex indices, counter-clockwise seen from outside where the file keeps that convention.
    pub triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// Number of undirected edges that do not belong to exactly two triangles running along them in opposite directions.
    #[must_use]
    pub fn boundary_edge_count(&self) -> usize {
        let mut edges: HashMap<[u32; 2], (u32, i32)> = HashMap::with_capacity(self.triangles.len() * 2);
        for t in &self.triangles {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                let edge = edges.entry([a.min(b), a.max(b)]).or_default();
                edge.0 += 1;
                edge.1 += if a < b { 1 } else { -1 };
            }
        }
        edges.values().filter(|&&(n, balance)| n != 2 || balance != 0).count()
    }

    /// Whether every edge joins two triangles of the same orientation.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        !self.triangles.is_empty() && self.boundary_edge_count() == 0
    }

    /// The mesh with every vertex multiplied by `scale`.
    #[must_use]
    pub fn scaled(&self, scale: f32) -> Self {
        self.transformed(scale, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [0.0; 3])
    }

    /// Every vertex `p` mapped to `scale * rotation * p + translation`; `rotation` by rows. A map that mirrors also turns
    /// the triangles round, so that they keep facing outwards.
    #[must_use]
    pub fn transformed(&self, scale: f32, rotation: [[f32; 3]; 3], translation: [f32; 3]) -> Self {
        let [a, b, c] = rotation;
        let det = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
            + a[2] * (b[0] * c[1] - b[1] * c[0]);
        let mirrors = det * scale < 0.0;
        Self {
            vertices: self.vertices.iter().map(|&p| transform_point(p, scale, &rotation, translation)).collect(),
            triangles: self.triangles.iter().map(|&[i, j, k]| if mirrors { [i, k, j] } else { [i, j, k] }).collect(),
        }
    }

    /// Smallest and largest coordinates; `None` without vertices.
    #[must_use]
    pub fn bounds(&self) -> Option<([f32; 3], [f32; 3])> {
        let first = *self.vertices.first()?;
        Some(self.vertices.iter().fold((first, first), |(lo, hi), p| {
            (std::array::from_fn(|k| lo[k].min(p[k])), std::array::from_fn(|k| hi[k].max(p[k])))
        }))
    }

    /// Checks that there are triangles, coordinates are finite and indices in range; `path` serves the error text.
    ///
    /// # Errors
    /// [`Error::BadMesh`] naming the first offence.
    pub fn validate(&self, path: &Path) -> Result<()> {
        let refuse = |reason: String| Err(Error::BadMesh { path: path.to_path_buf(), reason });
        if self.triangles.is_empty() {
            return refuse("it has no triangles".into());
        }
        if let Some(i) = self.vertices.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return refuse(format!("vertex {i} is not finite"));
        }
        let n = self.vertices.len();
        if let Some(i) = self.triangles.iter().position(|t| t.iter().any(|&v| v as usize >= n)) {
            return refuse(format!("triangle {i} names a vertex past the last of {n}"));
        }
        Ok(())
    }
}

/// Reads a mesh by its extension, `.obj`, `.stl` or `.ply`.
///
/// # Errors
/// Those of the format's reader; [`Error::UnknownExtension`] for any other extension.
pub fn read_mesh(path: &Path, unit: LengthUnit) -> Result<TriMesh> {
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    match extension.as_deref() {
        Some("obj") => read_obj(path, unit),
        Some("stl") => read_stl(path, unit),
        Some("ply") => crate::ply::read_ply(path, unit),
        _ => Err(Error::UnknownExtension { path: path.to_path_buf(), expected: ".obj, .stl, .ply" }),
    }
}

/// Reads all objects of an OBJ file as one mesh; polygons become fans, points and lines are left out.
///
/// The parser is our own: of the whole format a solid needs two kinds of line, errors should name the line, and the usual
/// crate refuses files in which only some vertices carry a colour.
///
/// # Errors
/// When the file cannot be read or parsed, or does not hold a usable mesh.
pub fn read_obj(path: &Path, unit: LengthUnit) -> Result<TriMesh> {
    parse_obj(path, &read_file(path)?, unit)
}

/// [`read_obj`] from bytes; `path` serves the error texts.
///
/// # Errors
/// As [`read_obj`].
pub fn parse_obj(path: &Path, bytes: &[u8], unit: LengthUnit) -> Result<TriMesh> {
    let mut positions: Vec<[f32; 3]> = Vec::new();
    let mut weld = Weld::default();
    let mut face: Vec<[f32; 3]> = Vec::new();
    for (i, line) in bytes.split(|&b| b == b'\n').enumerate() {
        let bad = |reason: String| Error::BadLine { path: path.to_path_buf(), line: i + 1, reason };
        // Names and comments may be in any encoding; only vertices and faces are read.
        if !(line.starts_with(b"v ") || line.starts_with(b"v\t") || line.starts_with(b"f ") || line.starts_with(b"f\t"))
        {
            continue;
        }
        let text = std::str::from_utf8(line).map_err(|_| bad("not UTF-8".into()))?;
        let mut words = text.split_whitespace();
        if words.next() == Some("v") {
            let mut p = [0.0; 3];
            for x in &mut p {
                let word = words.next().ok_or_else(|| bad("a vertex needs three coordinates".into()))?;
                *x = word.parse().map_err(|_| bad(format!("{word:?} is not a number")))?;
            }
            positions.push(p);
            continue;
        }
        face.clear();
        for word in words {
            let p = obj_index(word, positions.len())
                .ok_or_else(|| bad(format!("{word:?} names none of the {} vertices so far", positions.len())))?;
            face.push(positions[p]);
        }
        for k in 2..face.len() {
            weld.add([face[0], face[k - 1], face[k]]);
        }
    }
    weld.finish(path, unit)
}

/// The vertex a corner such as `7`, `7/1/2` or `-1//2` names: from 1, or back from the latest of `n` vertices.
fn obj_index(corner: &str, n: usize) -> Option<usize> {
    let index: i64 = corner.split('/').next()?.parse().ok()?;
    let from_zero = if index < 0 { n as i64 + index } else { index - 1 };
    usize::try_from(from_zero).ok().filter(|&p| p < n)
}

/// Reads an STL file, binary or ASCII.
///
/// # Errors
/// When the file cannot be read or parsed, or does not hold a usable mesh.
pub fn read_stl(path: &Path, unit: LengthUnit) -> Result<TriMesh> {
    parse_stl(path, &read_file(path)?, unit)
}

/// [`read_stl`] from bytes; `path` serves the error texts.
///
/// # Errors
/// As [`read_stl`].
pub fn parse_stl(path: &Path, bytes: &[u8], unit: LengthUnit) -> Result<TriMesh> {
    let refuse = |e: std::io::Error| Error::BadMesh { path: path.to_path_buf(), reason: e.to_string() };
    let looks_ascii = bytes.starts_with(b"solid");
    if !looks_ascii {
        let mut r = crate::bytes::ByteReader::new(path, bytes);
        r.seek(80);
        let n = r.u32("triangle count")?;
        r.take(u64::from(n), 50, "triangles")?;
    }
    let mut cursor = Cursor::new(bytes);
    let mut weld = Weld::default();
    for triangle in stl_io::create_stl_reader(&mut cursor).map_err(refuse)? {
        weld.add(triangle.map_err(refuse)?.vertices.map(|v| v.0));
    }
    weld.finish(path, unit)
}

/// Collects triangles by their corners and merges vertices of equal position.
#[derive(Default)]
pub(crate) struct Weld {
    corners: Vec<[[f32; 3]; 3]>,
}

impl Weld {
    pub(crate) fn add(&mut self, corners: [[f32; 3]; 3]) {
        self.corners.push(corners);
    }

    pub(crate) fn finish(self, path: &Path, unit: LengthUnit) -> Result<TriMesh> {
        let finite = |t: &[[f32; 3]; 3]| t.iter().flatten().all(|x| x.is_finite());
        if let Some(i) = self.corners.iter().position(|t| !finite(t)) {
            return Err(Error::BadMesh {
                path: path.to_path_buf(),
                reason: format!("a corner of triangle {i} is not finite"),
            });
        }
        let cm = unit.cm_per_unit();
        let largest = self.corners.iter().flatten().flatten().fold(0.0_f32, |m, x| m.max(x.abs()));
        let mut vertices = Vertices::new(f64::from(largest) * MERGE_TOLERANCE);
        let mut triangles = Vec::with_capacity(self.corners.len());
        for corners in self.corners {
            let [a, b, c] = corners.map(|p| vertices.index_of(p));
            if a != b && b != c && c != a {
                triangles.push([a, b, c]);
            }
        }
        let mut mesh = TriMesh { vertices: vertices.list, triangles };
        for x in mesh.vertices.iter_mut().flatten() {
            *x = (f64::from(*x) * cm) as f32;
        }
        mesh.validate(path)?;
        Ok(mesh)
    }
}

/// Vertices found by position: a grid of cells twice the tolerance wide, so that equal ones lie in a cell or the next.
struct Vertices {
    list: Vec<[f32; 3]>,
    tolerance: f64,
    first_in_cell: HashMap<[i64; 3], u32>,
    /// For each vertex, the one before it in its cell.
    next: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl Vertices {
    fn new(tolerance: f64) -> Self {
        // A mesh that is one point at the origin still needs cells of some size.
        let tolerance = tolerance.max(f64::MIN_POSITIVE);
        Self { list: Vec::new(), tolerance, first_in_cell: HashMap::new(), next: Vec::new() }
    }

    /// The vertex at `p`, added when there is none yet. The first of several that are equal wins, in file order.
    fn index_of(&mut self, p: [f32; 3]) -> u32 {
        let at = p.map(|x| f64::from(x) / (2.0 * self.tolerance));
        let cell = at.map(|x| x.floor() as i64);
        // Per axis only the neighbour on the nearer side can hold a vertex within the tolerance.
        let side: [i64; 3] = std::array::from_fn(|k| if at[k] - at[k].floor() < 0.5 { -1 } else { 1 });
        let mut found = NONE;
        for corner in 0..8 {
            let near = std::array::from_fn(|k| cell[k].saturating_add(if corner >> k & 1 == 1 { side[k] } else { 0 }));
            let mut v = self.first_in_cell.get(&near).copied().unwrap_or(NONE);
            while v != NONE {
                let q = self.list[v as usize];
                if (0..3).all(|k| (f64::from(q[k]) - f64::from(p[k])).abs() <= self.tolerance) {
                    found = found.min(v);
                }
                v = self.next[v as usize];
            }
        }
        if found == NONE {
            found = self.list.len() as u32;
            self.list.push(p);
            self.next.push(self.first_in_cell.insert(cell, found).unwrap_or(NONE));
        }
        found
    }
}

/// Writes an OBJ file in centimetres.
///
/// # Errors
/// When the mesh is not usable or the file cannot be written.
pub fn write_obj(path: &Path, mesh: &TriMesh) -> Result<()> {
    mesh.validate(path)?;
    let temporary = temporary_path(path);
    let file = std::fs::File::create(&temporary).map_err(Error::io("create", &temporary))?;
    let mut out = BufWriter::new(file);
    let mut write = || -> std::io::Result<()> {
        for [x, y, z] in &mesh.vertices {
            writeln!(out, "v {x} {y} {z}")?;
        }
        for [a, b, c] in mesh.triangles.iter().map(|t| t.map(|v| u64::from(v) + 1)) {
            writeln!(out, "f {a} {b} {c}")?;
        }
        out.flush()
    };
    write().map_err(Error::io("write", &temporary))?;
    let file = out.into_inner().map_err(|e| Error::io("write", &temporary)(e.into_error()))?;
    publish(file, &temporary, path)
}
