//! Roots embedded in a scalp that deforms: each by barycentric weights in one triangle of its mesh (MS08 §6: "the first
//! few points at the hair root were embedded in the head model barycentrically").
//!
//! The root goes exactly where its weights put it on the deformed triangle; the directions of the first points follow
//! the triangle's orthonormal frame (one edge, the normal), which a rigid motion of the scalp carries exactly and a
//! stretch leaves orthonormal. The triangle's own stretch moves roots apart, not the points of one strand.

mod nearest;

use crate::error::Error;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use nearest::Nearest;

/// Where the roots of a groom sit on a scalp mesh.
#[derive(Clone, Debug)]
pub struct Scalp {
    n_vertices: usize,
    /// One a strand.
    bindings: Vec<Binding>,
}

/// Where one root sits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Binding {
    /// Vertices of the triangle.
    pub vertices: [u32; 3],
    /// Barycentric weights; they sum to one, and all lie between 0 and 1.
    pub weights: [f64; 3],
    /// The root less its place on the triangle, in the triangle's frame: zero for a root on the mesh, cm.
    pub lift: Vector3<f64>,
    /// Root at rest, cm.
    root: Vector3<f64>,
    /// Frame of the triangle at rest.
    rest: UnitQuaternion<f64>,
}

/// A triangle counts as without area below this share of its longest edge squared: its normal is then round-off.
const LEAST_AREA_SHARE: f64 = 1e-9;

impl Scalp {
    /// Binds each root to the nearest triangle of the rest mesh, all in the frame of the strands' rest shape, cm.
    /// Triangles without area are passed over; of triangles equally near, the first in the mesh counts.
    ///
    /// # Errors
    /// A vertex or root that is not finite, a triangle that names a vertex the mesh does not have, or no triangle with
    /// an area.
    pub fn bind(vertices: &[Vector3<f64>], triangles: &[[u32; 3]], roots: &[Vector3<f64>]) -> Result<Self, Error> {
        check_finite(vertices)?;
        let usable = usable_triangles(vertices, triangles)?;
        let places: Vec<_> = usable.iter().map(|t| corners(vertices, t)).collect();
        let tree = Nearest::new(&places);
        let bindings = roots.iter().enumerate().map(|(strand, &root)| {
            if !root.iter().all(|c| c.is_finite()) {
                return Err(Error::NonFinite { strand, particle: 0 });
            }
            let weights = |t: usize| nearest_weights(places[t], root);
            let gap = |t: usize| (root - at(vertices, &usable[t], &weights(t))).norm_squared();
            let nearest = tree.find(root, gap).and_then(|t| Binding::new(vertices, usable[t], weights(t), root));
            nearest.ok_or(Error::NoTriangles { n_triangles: triangles.len() })
        });
        Ok(Self { n_vertices: vertices.len(), bindings: bindings.collect::<Result<_, _>>()? })
    }

    /// One binding a strand.
    #[must_use]
    pub fn bindings(&self) -> &[Binding] {
        &self.bindings
    }

    /// Where the roots are on the mesh deformed to `vertices`, by weights alone, cm.
    pub fn roots<'a>(&'a self, vertices: &'a [Vector3<f64>]) -> impl Iterator<Item = Vector3<f64>> + 'a {
        self.bindings.iter().map(|b| at(vertices, &b.vertices, &b.weights))
    }

    /// The pose that carries each strand's rest shape on the mesh deformed to `vertices` (cm), as
    /// [`crate::RootMotion::Frames`] takes it. `frames` gets one entry a strand; it does not allocate once it has had them.
    ///
    /// # Errors
    /// Vertices of another mesh, a vertex that is not finite, or a triangle under a root that has lost its area;
    /// `frames` is then unchanged.
    pub fn frames(&self, vertices: &[Vector3<f64>], frames: &mut Vec<Isometry3<f64>>) -> Result<(), Error> {
        if vertices.len() != self.n_vertices {
            return Err(Error::OtherMesh { n_vertices: vertices.len(), expected: self.n_vertices });
        }
        check_finite(vertices)?;
        if let Some(strand) = self.bindings.iter().position(|b| frame_of(corners(vertices, &b.vertices)).is_none()) {
            let area_cm2 = area(corners(vertices, &self.bindings[strand].vertices));
            return Err(Error::LostTriangle { strand, area_cm2 });
        }
        frames.clear();
        frames.extend(self.bindings.iter().map(|b| b.frame(vertices)));
        Ok(())
    }
}

impl Binding {
    fn new(vertices: &[Vector3<f64>], triangle: [u32; 3], weights: [f64; 3], root: Vector3<f64>) -> Option<Self> {
        let rest = frame_of(corners(vertices, &triangle))?;
        let lift = rest.inverse() * (root - at(vertices, &triangle, &weights));
        Some(Self { vertices: triangle, weights, lift, root, rest })
    }

    /// The rigid pose that takes the rest root to its place on the deformed mesh.
    fn frame(&self, vertices: &[Vector3<f64>]) -> Isometry3<f64> {
        let now = frame_of(corners(vertices, &self.vertices)).unwrap_or(self.rest);
        let turn = now * self.rest.inverse();
        let root = at(vertices, &self.vertices, &self.weights) + now * self.lift;
        Isometry3::from_parts(Translation3::from(root - turn * self.root), turn)
    }
}

fn check_finite(vertices: &[Vector3<f64>]) -> Result<(), Error> {
    match vertices.iter().position(|v| !v.iter().all(|c| c.is_finite())) {
        Some(point) => Err(Error::NonFinitePoint { point }),
        None => Ok(()),
    }
}

fn usable_triangles(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Result<Vec<[u32; 3]>, Error> {
    let n_points = vertices.len();
    for (element, t) in triangles.iter().enumerate() {
        if let Some(&point) = t.iter().find(|&&v| v as usize >= n_points) {
            return Err(Error::UnknownPoint { element, point: point as usize, n_points });
        }
    }
    let usable: Vec<_> = triangles.iter().copied().filter(|t| frame_of(corners(vertices, t)).is_some()).collect();
    if usable.is_empty() { Err(Error::NoTriangles { n_triangles: triangles.len() }) } else { Ok(usable) }
}

fn corners(vertices: &[Vector3<f64>], triangle: &[u32; 3]) -> [Vector3<f64>; 3] {
    triangle.map(|v| vertices[v as usize])
}

fn at(vertices: &[Vector3<f64>], triangle: &[u32; 3], weights: &[f64; 3]) -> Vector3<f64> {
    let [a, b, c] = corners(vertices, triangle);
    a * weights[0] + b * weights[1] + c * weights[2]
}

fn area([a, b, c]: [Vector3<f64>; 3]) -> f64 {
    0.5 * (b - a).cross(&(c - a)).norm()
}

/// First edge, across it in the plane, normal; `None` without an area.
fn frame_of([a, b, c]: [Vector3<f64>; 3]) -> Option<UnitQuaternion<f64>> {
    let (edge, other) = (b - a, c - a);
    let normal = edge.cross(&other);
    let longest = edge.norm_squared().max(other.norm_squared()).max((c - b).norm_squared());
    // Not a number fails the comparison too.
    let sound = normal.norm() > LEAST_AREA_SHARE * longest;
    if !sound {
        return None;
    }
    let (x, z) = (edge.normalize(), normal.normalize());
    let axes = Matrix3::from_columns(&[x, z.cross(&x), z]);
    Some(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes)))
}

/// Barycentric weights of the point of a triangle nearest to `p`.
fn nearest_weights([a, b, c]: [Vector3<f64>; 3], p: Vector3<f64>) -> [f64; 3] {
    let (edge, other) = (b - a, c - a);
    let normal = edge.cross(&other);
    let inv = 1.0 / normal.norm_squared();
    let wb = (p - a).cross(&other).dot(&normal) * inv;
    let wc = edge.cross(&(p - a)).dot(&normal) * inv;
    let wa = 1.0 - wb - wc;
    if wa >= 0.0 && wb >= 0.0 && wc >= 0.0 {
        return [wa, wb, wc];
    }
    // Outside the triangle's prism the nearest point is on its border.
    let on_edge = |from: Vector3<f64>, to: Vector3<f64>| {
        let along = to - from;
        ((p - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0)
    };
    let (t0, t1, t2) = (on_edge(a, b), on_edge(b, c), on_edge(c, a));
    let candidates = [[1.0 - t0, t0, 0.0], [0.0, 1.0 - t1, t1], [t2, 0.0, 1.0 - t2]];
    let gap = |w: &[f64; 3]| (p - (a * w[0] + b * w[1] + c * w[2])).norm_squared();
    let mut best = candidates[0];
    for w in &candidates[1..] {
        if gap(w) < gap(&best) {
            best = *w;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pseudo-random numbers in 0..1 from a number: the fractions of an irrational rotation.
    fn spread(n: usize) -> [f64; 3] {
        [0.754_877_666, 0.569_840_291, 0.819_172_513].map(|step: f64| (0.5 + step * n as f64).fract())
    }

    /// By going through all triangles.
    fn bind_plainly(vertices: &[Vector3<f64>], triangles: &[[u32; 3]], root: Vector3<f64>) -> Binding {
        let usable = usable_triangles(vertices, triangles).expect("a mesh with area");
        let of = |t: &[u32; 3]| nearest_weights(corners(vertices, t), root);
        let gap = |t: &[u32; 3]| (root - at(vertices, t, &of(t))).norm_squared();
        let nearest = usable.iter().min_by(|a, b| gap(a).total_cmp(&gap(b))).expect("a triangle");
        Binding::new(vertices, *nearest, of(nearest), root).expect("an area")
    }

    #[test]
    fn the_tree_binds_roots_as_going_through_all_triangles_does() {
        const SIDE: usize = 24;
        // A bumpy sheet, every edge and vertex of it shared, so that roots on them are equally near several triangles.
        let vertices: Vec<_> = (0..SIDE * SIDE)
            .map(|n| Vector3::new((n % SIDE) as f64, 2.0 * spread(n)[0], (n / SIDE) as f64) * 0.5)
            .collect();
        let mut triangles: Vec<[u32; 3]> = (0..SIDE * (SIDE - 1))
            .filter(|n| n % SIDE + 1 < SIDE)
            .flat_map(|n| [[n, n + SIDE, n + 1], [n + 1, n + SIDE, n + SIDE + 1]])
            .map(|t| t.map(|v| v as u32))
            .collect();
        triangles.push([3, 3, 9]);
        let size = 0.5 * SIDE as f64;
        let mut roots: Vec<_> = (0..400)
            .map(|n| {
                let [x, y, z] = spread(n);
                Vector3::new((1.4 * x - 0.2) * size, 4.0 * y - 1.0, (1.4 * z - 0.2) * size)
            })
            .collect();
        // On vertices, on the middles of edges, and far off.
        roots.extend(vertices.iter().step_by(7));
        roots.extend(triangles.iter().step_by(5).map(|t| (vertices[t[0] as usize] + vertices[t[1] as usize]) * 0.5));
        roots.push(Vector3::new(500.0, -300.0, 80.0));
        let scalp = Scalp::bind(&vertices, &triangles, &roots).expect("a sound mesh");
        for (found, &root) in scalp.bindings().iter().zip(&roots) {
            assert_eq!(*found, bind_plainly(&vertices, &triangles, root), "root {root:?}");
        }
    }

    #[test]
    fn a_root_is_compared_with_few_triangles() {
        // Of a fine flat sheet: a search that opens every box would look at them all.
        const SIDE: usize = 100;
        let place = |n: usize| Vector3::new((n % SIDE) as f64, 0.0, (n / SIDE) as f64);
        let places: Vec<_> =
            (0..SIDE * SIDE).map(|n| [place(n), place(n) + Vector3::x(), place(n) + Vector3::z()]).collect();
        let tree = Nearest::new(&places);
        let mut looked = 0;
        for n in 0..50 {
            let [x, _, z] = spread(n);
            let root = Vector3::new(x, 0.01, z) * SIDE as f64;
            let gap = |t: usize| {
                let w = nearest_weights(places[t], root);
                looked += 1;
                (root - (places[t][0] * w[0] + places[t][1] * w[1] + places[t][2] * w[2])).norm_squared()
            };
            assert!(tree.find(root, gap).is_some());
        }
        assert!(looked < 50 * places.len() / 100, "{looked} distances for 50 roots");
    }
}
