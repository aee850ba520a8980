//! Makes a closed surface of the triangles of a solid, or says why it has no inside.
//!
//! Duplicate vertices are welded and triangles turned to agree with their neighbours. What is then left of the boundary,
//! each edge counted with its direction, is a set of closed curves; each is closed by a fan about its middle. The result
//! has no boundary whatever the mesh was, so the number of times that it winds around a point is an integer, and a point is inside
//! where that is not zero: also of solids that overlap themselves, are put together from parts, or are inside out
//! (after Jacobson et al. 2013, and with groups taken together after Barill et al. 2018). Parts that face against each
//! other cancel where they overlap, as the inner wall of a hollow does.

use nalgebra::Vector3;
use parry3d::math::Vector;
use parry3d::shape::TriMesh;

use crate::error::Error;
use crate::sdf::grid::Bounds;
use crate::sdf::tree::TriangleTree;

/// A surface that encloses a volume.
#[derive(Debug, Clone)]
pub(crate) struct ClosedMesh {
    /// Vertices as given, then the middles of the fans, cm.
    pub points: Vec<Vector3<f32>>,
    /// The mesh's triangles, outwards on the whole, then those of the fans.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles of the mesh itself.
    n_own: usize,
    /// The box around them.
    pub bounds: Bounds,
    /// The triangles indexed.
    pub tree: TriangleTree,
}

/// A mesh counts as flat when it fills less than this share of its bounding box.
const FLAT_SHARE: f64 = 1e-9;

/// Most area, as a share of the mesh's own, by which holes may be closed: a box without its lid needs a fifth, half a
/// ball already a half, and of a sheet nobody can say what is behind it.
const MOST_CAPPED: f64 = 0.35;

impl ClosedMesh {
    /// Closes and indexes a mesh (cm). Collapsed triangles are dropped.
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
        let mut welded: Vec<[u32; 3]> = triangles
            .iter()
            .map(|t| t.map(|v| same_as[v as usize]))
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect();
        let bounds = Bounds::around(positions).filter(|_| welded.len() >= 3 && n_vertices >= 4);
        let Some(bounds) = bounds else {
            return Err(Error::EmptyMesh { n_vertices, n_triangles: welded.len() });
        };
        let mut points: Vec<Vector3<f32>> = positions.iter().map(|&p| p.into()).collect();
        turn_to_agree(&mut welded)?;
        let n_own = welded.len();
        let holes = close_holes(&mut points, &mut welded);

        let volumes = Volumes::of(&points, &welded, n_own, &bounds);
        let box_cm3 = bounds.size().iter().map(|&s| f64::from(s)).product::<f64>();
        if let Some(first) = holes.first
            && volumes.caps > MOST_CAPPED * volumes.own
        {
            let share_pct = (100.0 * volumes.caps / volumes.own) as f32;
            return Err(Error::OpenMesh { n_edges: holes.count, first, share_pct });
        }
        if volumes.enclosed <= FLAT_SHARE * box_cm3 {
            return Err(Error::NoVolume { volume_cm3: volumes.signed, box_cm3 });
        }
        if volumes.signed < 0.0 {
            welded.iter_mut().for_each(|t| t.swap(1, 2));
        }
        let tree = TriangleTree::new(&points, &welded);
        Ok(Self { points, triangles: welded, n_own, bounds, tree })
    }

    /// Whether `p` (cm) is inside: wound around at least once, either way.
    pub fn is_inside(&self, p: Vector3<f32>) -> bool {
        self.tree.winding(p).abs() > 0.5
    }

    /// Area of all triangles, cm².
    pub fn area(&self) -> f32 {
        let twice = self.triangles.iter().map(|t| {
            let [a, b, c] = t.map(|v| self.points[v as usize]);
            (b - a).cross(&(c - a)).norm()
        });
        0.5 * twice.sum::<f32>()
    }

    /// The mesh's own triangles for rays and for places on them.
    pub fn indexed(&self) -> Result<TriMesh, Error> {
        let own = self.triangles[..self.n_own].to_vec();
        let points = self.points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
        TriMesh::new(points, own).map_err(|e| Error::Unusable { reason: e.to_string() })
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

/// An edge of a triangle: its vertices in increasing order, whether it runs that way, and the triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    ends: [u32; 2],
    forward: bool,
    triangle: u32,
}

/// All edges, those of equal ends side by side.
fn edges(triangles: &[[u32; 3]]) -> Vec<Edge> {
    let mut edges: Vec<Edge> = triangles
        .iter()
        .enumerate()
        .flat_map(|(n, &[a, b, c])| {
            [(a, b), (b, c), (c, a)].map(|(a, b)| Edge {
                ends: [a.min(b), a.max(b)],
                forward: a < b,
                triangle: n as u32,
            })
        })
        .collect();
    edges.sort_unstable();
    edges
}

/// Turns triangles so that neighbours agree, in every connected piece as most of them were.
fn turn_to_agree(triangles: &mut [[u32; 3]]) -> Result<(), Error> {
    const NONE: u32 = u32::MAX;
    let edges = edges(triangles);
    let pairs = || {
        edges.chunk_by(|a, b| a.ends == b.ends).filter_map(|edge| match edge {
            [one, other] if one.triangle != other.triangle => Some((one, other)),
            _ => None,
        })
    };
    if pairs().all(|(one, other)| one.forward != other.forward) {
        return Ok(());
    }
    let mut neighbours = vec![[(NONE, false); 3]; triangles.len()];
    for (one, other) in pairs() {
        let twisted = one.forward == other.forward;
        for (from, to) in [(one, other), (other, one)] {
            if let Some(free) = neighbours[from.triangle as usize].iter_mut().find(|n| n.0 == NONE) {
                *free = (to.triangle, twisted);
            }
        }
    }
    let mut turned: Vec<Option<bool>> = vec![None; triangles.len()];
    let mut piece = Vec::new();
    for start in 0..triangles.len() {
        if turned[start].is_some() {
            continue;
        }
        turned[start] = Some(false);
        piece.clear();
        piece.push(start);
        let mut next = 0;
        while next < piece.len() {
            let here = piece[next];
            next += 1;
            let state = turned[here] == Some(true);
            for &(there, twisted) in neighbours[here].iter().filter(|n| n.0 != NONE) {
                if turned[there as usize].is_none() {
                    turned[there as usize] = Some(state != twisted);
                    piece.push(there as usize);
                }
            }
        }
        let n_turned = piece.iter().filter(|&&t| turned[t] == Some(true)).count();
        let keep = 2 * n_turned <= piece.len();
        for &t in &piece {
            if (turned[t] == Some(true)) == keep {
                triangles[t].swap(1, 2);
            }
        }
    }
    let mut one_sided = Defect::default();
    for (one, other) in pairs() {
        let differ = turned[one.triangle as usize] != turned[other.triangle as usize];
        if (one.forward == other.forward) != differ {
            one_sided.add(one.ends);
        }
    }
    match one_sided.first {
        Some(first) => Err(Error::OneSided { n_edges: one_sided.count, first }),
        None => Ok(()),
    }
}

/// Closes what is left of the boundary by a fan about the middle of each of its connected pieces.
fn close_holes(points: &mut Vec<Vector3<f32>>, triangles: &mut Vec<[u32; 3]>) -> Defect {
    let mut defect = Defect::default();
    // From, to, how often.
    let mut rim: Vec<([u32; 2], usize)> = Vec::new();
    for edge in edges(triangles).chunk_by(|a, b| a.ends == b.ends) {
        let balance = edge.iter().map(|e| if e.forward { 1i32 } else { -1 }).sum::<i32>();
        if balance != 0 {
            let [a, b] = edge[0].ends;
            rim.push((if balance > 0 { [a, b] } else { [b, a] }, balance.unsigned_abs() as usize));
            defect.add(edge[0].ends);
        }
    }
    if rim.is_empty() {
        return defect;
    }
    let mut piece_of = Pieces::new(points.len());
    for ([a, b], _) in &rim {
        piece_of.join(*a, *b);
    }
    rim.sort_by_key(|(ends, _)| piece_of.root(ends[0]));
    for piece in rim.chunk_by(|a, b| piece_of.root_of(a.0[0]) == piece_of.root_of(b.0[0])) {
        if let [([a, b], 1), (_, 1), (_, 1)] = *piece
            && let Some(([_, c], _)) = piece.iter().find(|(ends, _)| ends[0] == b)
        {
            triangles.push([b, a, *c]);
            continue;
        }
        let (mut sum, mut weight) = (Vector3::zeros(), 0.0);
        for ([a, b], _) in piece {
            let ends = [*a, *b].map(|v| points[v as usize].cast::<f64>());
            let length = (ends[1] - ends[0]).norm();
            sum += (ends[0] + ends[1]) * (0.5 * length);
            weight += length;
        }
        let apex = points.len() as u32;
        let fallback = points[piece[0].0[0] as usize];
        points.push(if weight > 0.0 { (sum / weight).cast() } else { fallback });
        for ([a, b], times) in piece {
            triangles.extend(std::iter::repeat_n([*b, *a, apex], *times));
        }
    }
    defect
}

/// Vertices joined into pieces.
struct Pieces(Vec<u32>);

impl Pieces {
    fn new(n: usize) -> Self {
        Self((0..n as u32).collect())
    }

    fn root_of(&self, mut v: u32) -> u32 {
        while self.0[v as usize] != v {
            v = self.0[v as usize];
        }
        v
    }

    fn root(&mut self, v: u32) -> u32 {
        let root = self.root_of(v);
        let mut at = v;
        while at != root {
            at = std::mem::replace(&mut self.0[at as usize], root);
        }
        root
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
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

/// Volumes (cm³) and areas (cm²) of a closed mesh.
struct Volumes {
    /// With its sign.
    signed: f64,
    /// Of its connected pieces, without their signs.
    enclosed: f64,
    /// Area of the mesh's own triangles.
    own: f64,
    /// Area of the fans.
    caps: f64,
}

impl Volumes {
    fn of(points: &[Vector3<f32>], triangles: &[[u32; 3]], n_own: usize, bounds: &Bounds) -> Self {
        let mut pieces = Pieces::new(points.len());
        for &[a, b, c] in triangles {
            pieces.join(a, b);
            pieces.join(b, c);
        }
        // About the middle of the box, where cancellation is least.
        let middle = bounds.center().cast::<f64>();
        let mut of_piece = vec![0.0; points.len()];
        let mut areas = [0.0; 2];
        for (n, t) in triangles.iter().enumerate() {
            let [a, b, c] = t.map(|v| points[v as usize].cast::<f64>() - middle);
            of_piece[pieces.root(t[0]) as usize] += a.dot(&b.cross(&c)) / 6.0;
            areas[usize::from(n >= n_own)] += 0.5 * (b - a).cross(&(c - a)).norm();
        }
        Self {
            signed: of_piece.iter().sum(),
            enclosed: of_piece.iter().map(|v| v.abs()).sum(),
            own: areas[0],
            caps: areas[1],
        }
    }
}
