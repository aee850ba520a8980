//! Which triangle soups have an inside: welding, then closed, manifold, consistently wound, facing outwards.
//!
//! The sign of a distance comes from the pseudo-normal of the nearest feature, which is right everywhere exactly for such
//! meshes. Self-intersection is not looked for: where sheets cross, the sign follows the nearest sheet.

use parry3d::math::Vector;
use parry3d::shape::{TriMesh, TriMeshFlags};

use crate::error::Error;
use crate::sdf::grid::Bounds;

/// A mesh that encloses a volume, ready for distance queries.
pub(crate) struct ClosedMesh {
    pub mesh: TriMesh,
    pub bounds: Bounds,
}

/// A mesh counts as flat when it fills less than this share of its bounding box.
const FLAT_SHARE: f64 = 1e-9;

impl ClosedMesh {
    /// Checks a mesh (cm) and indexes it. Vertices with equal coordinates are welded, collapsed triangles dropped.
    pub fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Result<Self, Error> {
        for (vertex, &position) in positions.iter().enumerate() {
            if !position.iter().all(|x| x.is_finite()) {
                return Err(Error::NonFiniteVertex { vertex, position });
            }
        }
        let n_vertices = positions.len();
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= n_vertices) {
                return Err(Error::UnknownVertex { triangle, vertex, n_vertices });
            }
        }
        let same_as = weld(positions);
        let welded: Vec<[u32; 3]> = triangles
            .iter()
            .map(|t| t.map(|v| same_as[v as usize]))
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect();
        let bounds = Bounds::around(positions).filter(|_| welded.len() >= 4 && n_vertices >= 4);
        let Some(bounds) = bounds else {
            return Err(Error::EmptyMesh { n_vertices, n_triangles: welded.len() });
        };
        check_edges(&welded)?;

        let volume_cm3 = signed_volume(positions, &welded, &bounds);
        let box_cm3 = bounds.size().iter().map(|&s| f64::from(s)).product::<f64>();
        if volume_cm3.abs() <= FLAT_SHARE * box_cm3 {
            return Err(Error::NoVolume { volume_cm3, box_cm3 });
        }
        if volume_cm3 < 0.0 {
            return Err(Error::InwardFacing { volume_cm3 });
        }

        let vertices = positions.iter().map(|p| Vector::new(p[0], p[1], p[2])).collect();
        let mesh = TriMesh::with_flags(vertices, welded, TriMeshFlags::ORIENTED)
            .map_err(|e| Error::Unusable { reason: e.to_string() })?;
        Ok(Self { mesh, bounds })
    }
}

/// For each vertex, the first one with the same coordinates.
fn weld(positions: &[[f32; 3]]) -> Vec<u32> {
    // Adding zero turns -0 into 0, so that equal coordinates have equal bits.
    let key = |v: u32| positions[v as usize].map(|x| (x + 0.0).to_bits());
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    order.sort_unstable_by_key(|&v| (key(v), v));
    let mut same_as = vec![0; positions.len()];
    let mut first = 0;
    for (n, &v) in order.iter().enumerate() {
        if n == 0 || key(v) != key(first) {
            first = v;
        }
        same_as[v as usize] = first;
    }
    same_as
}

fn check_edges(triangles: &[[u32; 3]]) -> Result<(), Error> {
    // (smaller vertex, larger vertex, runs from smaller to larger)
    let mut edges: Vec<(u32, u32, bool)> = triangles
        .iter()
        .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
        .map(|(a, b)| (a.min(b), a.max(b), a < b))
        .collect();
    edges.sort_unstable();

    let mut open = Defect::default();
    let mut crowded = Defect::default();
    let mut twisted = Defect::default();
    for edge in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        let ends = [edge[0].0, edge[0].1];
        match edge {
            [_] => open.add(ends),
            [one, other] if one.2 == other.2 => twisted.add(ends),
            [_, _] => {}
            _ => crowded.add(ends),
        }
    }
    if let Some(first) = open.first {
        return Err(Error::OpenMesh { n_edges: open.count, first });
    }
    if let Some(first) = crowded.first {
        return Err(Error::NonManifold { n_edges: crowded.count, first });
    }
    if let Some(first) = twisted.first {
        return Err(Error::InconsistentWinding { n_edges: twisted.count, first });
    }
    Ok(())
}

#[derive(Default)]
struct Defect {
    count: usize,
    first: Option<[u32; 2]>,
}

impl Defect {
    fn add(&mut self, ends: [u32; 2]) {
        self.count += 1;
        self.first.get_or_insert(ends);
    }
}

/// Six tetrahedra-volumes summed about the middle of the box, where cancellation is least; cm^3.
fn signed_volume(positions: &[[f32; 3]], triangles: &[[u32; 3]], bounds: &Bounds) -> f64 {
    let middle = bounds.center().cast::<f64>();
    let at = |v: u32| nalgebra::Vector3::from(positions[v as usize]).cast::<f64>() - middle;
    triangles.iter().map(|&[a, b, c]| at(a).dot(&at(b).cross(&at(c)))).sum::<f64>() / 6.0
}
