//! The triangles of a solid in a tree of boxes, asked for exact distances eight points at a time.
//!
//! A bake asks millions of neighbouring points: eight of them share one walk down the tree, and start from the triangles
//! found by their neighbours, so that almost every box is dismissed at once. Coordinates are taken to about a unit by a
//! power of two, exactly, so that nothing under- or overflows for solids of any size. The least of the same numbers is
//! taken in whatever order triangles are met, so answers do not depend on how points are grouped.

use multiversion::multiversion;
use nalgebra::Vector3;

/// Points asked together.
pub(crate) const PACKET: usize = 8;
/// Most triangles in a leaf.
const LEAF: usize = 4;
/// Below this many triangles a subtree is built by one thread.
const SPLIT_AMONG_THREADS: usize = 4096;
/// Halving the triangles at each level, no tree of `u32` indices is deeper.
const MAX_DEPTH: usize = 40;

/// One point in every lane.
pub(crate) type Points = [[f32; PACKET]; 3];

/// A triangle prepared for distances: a corner, two edges, and what their products give. One cache line.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct Facet {
    a: [f32; 3],
    ab: [f32; 3],
    ac: [f32; 3],
    ab_ab: f32,
    ab_ac: f32,
    ac_ac: f32,
    /// One over |ab|²|ac|² - (ab·ac)², |ab|², |ac|², |bc|²; zero for what has no length or area.
    inv_area: f32,
    inv_ab: f32,
    inv_ac: f32,
    inv_bc: f32,
}

/// A box and what lies in it.
#[derive(Debug, Clone, Copy, Default)]
struct Node {
    min: [f32; 3],
    max: [f32; 3],
    /// First facet of a leaf; of an inner node the second child. The first child is the next node.
    at: u32,
    /// Facets of a leaf, zero for an inner node.
    count: u32,
}

/// Sums over the triangles of a node, for their solid angle seen from afar.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moments {
    /// Mean position, weighted by area.
    pub middle: Vector3<f32>,
    /// Areas along the normals.
    pub area: Vector3<f32>,
    /// Areas without direction.
    pub size: f32,
    /// Farthest of any corner from the middle.
    pub radius: f32,
    /// Products (position - middle) ⊗ area, symmetric part: xx, yy, zz, xy, yz, zx, each pair of the last three summed.
    pub second: [f32; 6],
}

/// Triangles indexed for distances and solid angles.
#[derive(Debug, Clone)]
pub(crate) struct TriangleTree {
    nodes: Vec<Node>,
    facets: Vec<Facet>,
    moments: Vec<Moments>,
    middle: Vector3<f32>,
    scale: f32,
    inv_scale: f32,
}

/// What each of eight points is nearest to.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Nearest {
    /// Squared distances in the tree's own unit.
    d2: [f32; PACKET],
    facet: [u32; PACKET],
}

impl TriangleTree {
    /// Indexes triangles (cm) with corners in `points`; there must be one at least.
    pub fn new(points: &[Vector3<f32>], triangles: &[[u32; 3]]) -> Self {
        assert!(!triangles.is_empty(), "a solid has triangles");
        let (mut low, mut high) = (Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY));
        for v in triangles.iter().flatten() {
            low = low.inf(&points[*v as usize]);
            high = high.sup(&points[*v as usize]);
        }
        let middle = low * 0.5 + high * 0.5;
        let half = (high - middle).max().max((middle - low).max());
        // Within the range of exponents whose squares' squares are still numbers.
        let scale = if half > 0.0 { (-half.log2().ceil()).clamp(-100.0, 100.0).exp2() } else { 1.0 };
        let corners: Vec<[Vector3<f32>; 3]> =
            triangles.iter().map(|t| t.map(|v| (points[v as usize] - middle) * scale)).collect();
        let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
        let mut nodes = vec![Node::default(); tree_size(triangles.len())];
        build(&mut order, 0, &corners, &mut nodes, 0);
        let facets: Vec<Facet> = order.iter().map(|&t| Facet::new(corners[t as usize])).collect();
        let mut tree = Self { nodes, facets, moments: Vec::new(), middle, scale, inv_scale: 1.0 / scale };
        tree.moments = tree.sum_moments();
        tree
    }

    /// A point (cm) in the tree's own coordinates.
    pub fn own(&self, p: Vector3<f32>) -> Vector3<f32> {
        (p - self.middle) * self.scale
    }

    /// Looks for what eight points (cm) are nearest to, trying what `hint` found first.
    pub fn nearest(&self, points: &[Vector3<f32>; PACKET], hint: Option<&Nearest>) -> Nearest {
        let mut own: Points = [[0.0; PACKET]; 3];
        for (l, p) in points.iter().enumerate() {
            let p = self.own(*p);
            for k in 0..3 {
                own[k][l] = p[k];
            }
        }
        let mut best = Nearest { d2: [f32::INFINITY; PACKET], facet: [0; PACKET] };
        let seeds = hint.map_or([0; PACKET], |h| h.facet);
        search(&self.nodes, &self.facets, &own, &seeds, &mut best);
        best
    }

    /// Distances found, cm, none negative.
    pub fn distances(&self, nearest: &Nearest) -> [f32; PACKET] {
        nearest.d2.map(|d2| d2.sqrt() * self.inv_scale)
    }

    /// How often the surface winds around `p` (cm): an integer, up to the error of far groups taken together.
    pub fn winding(&self, p: Vector3<f32>) -> f32 {
        let q = self.own(p);
        let mut stack = [0u32; MAX_DEPTH];
        let mut depth = 1;
        let mut sum = 0.0f32;
        while depth > 0 {
            depth -= 1;
            let n = stack[depth] as usize;
            let (node, m) = (&self.nodes[n], &self.moments[n]);
            if let Some(w) = m.winding_from_afar(&q) {
                sum += w;
            } else if node.count > 0 {
                sum += self.facets[node.at as usize..][..node.count as usize].iter().map(|f| f.winding(&q)).sum::<f32>();
            } else {
                stack[depth] = node.at;
                stack[depth + 1] = n as u32 + 1;
                depth += 2;
            }
        }
        sum
    }

    /// The winding number by every triangle's solid angle: what [`Self::winding`] is compared with.
    #[cfg(test)]
    pub fn winding_of_all(&self, p: Vector3<f32>) -> f32 {
        let q = self.own(p);
        self.facets.iter().map(|f| f.winding(&q)).sum()
    }

    /// The distance to every triangle in turn, the least taken: what [`Self::nearest`] is compared with.
    #[cfg(test)]
    pub fn nearest_of_all(&self, p: Vector3<f32>) -> f32 {
        let own: Points = self.own(p).data.0[0].map(|x| [x; PACKET]);
        let d2 = self.facets.iter().map(|f| f.distance2(&own)[0]).fold(f32::INFINITY, f32::min);
        d2.sqrt() * self.inv_scale
    }

    fn sum_moments(&self) -> Vec<Moments> {
        let mut all = vec![Moments::default(); self.nodes.len()];
        // Children come after their parents.
        for n in (0..self.nodes.len()).rev() {
            let node = &self.nodes[n];
            let mut parts: Vec<Moments> = Vec::with_capacity(LEAF);
            if node.count > 0 {
                parts.extend(self.facets[node.at as usize..][..node.count as usize].iter().map(Facet::moments));
            } else {
                parts.extend([all[n + 1], all[node.at as usize]]);
            }
            all[n] = Moments::join(&parts, node);
        }
        all
    }
}

impl Facet {
    fn new([a, b, c]: [Vector3<f32>; 3]) -> Self {
        let (ab, ac) = (b - a, c - a);
        let [ab_ab, ab_ac, ac_ac] = [ab.norm_squared(), ab.dot(&ac), ac.norm_squared()];
        let inverse = |x: f32| if x > 0.0 && x.is_normal() { 1.0 / x } else { 0.0 };
        Self {
            a: a.into(),
            ab: ab.into(),
            ac: ac.into(),
            ab_ab,
            ab_ac,
            ac_ac,
            inv_area: inverse(ab_ab * ac_ac - ab_ac * ab_ac),
            inv_ab: inverse(ab_ab),
            inv_ac: inverse(ac_ac),
            inv_bc: inverse((c - b).norm_squared()),
        }
    }

    /// Squared distance of eight points: the least over the three edges, and the face where the foot is on it.
    #[inline(always)]
    fn distance2(&self, p: &Points) -> [f32; PACKET] {
        let mut out = [0.0; PACKET];
        let [ab, ac] = [self.ab, self.ac];
        for l in 0..PACKET {
            let ap = [p[0][l] - self.a[0], p[1][l] - self.a[1], p[2][l] - self.a[2]];
            let d1 = ab[0] * ap[0] + ab[1] * ap[1] + ab[2] * ap[2];
            let d2 = ac[0] * ap[0] + ac[1] * ap[1] + ac[2] * ap[2];
            // The point a + s ab + t ac of the triangle's plane.
            let from = |s: f32, t: f32| {
                let r = [0, 1, 2].map(|k: usize| ap[k] - s * ab[k] - t * ac[k]);
                r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
            };
            let s = (self.ac_ac * d1 - self.ab_ac * d2) * self.inv_area;
            let t = (self.ab_ab * d2 - self.ab_ac * d1) * self.inv_area;
            let on_face = (s >= 0.0) & (t >= 0.0) & (s + t <= 1.0) & (self.inv_area > 0.0);
            let face = from(s, t);
            let u = clamp01((d2 - d1 + self.ab_ab - self.ab_ac) * self.inv_bc);
            let edges = [
                from(clamp01(d1 * self.inv_ab), 0.0),
                from(0.0, clamp01(d2 * self.inv_ac)),
                from(1.0 - u, u),
            ];
            let edge = least(least(edges[0], edges[1]), edges[2]);
            out[l] = if on_face { least(face, edge) } else { edge };
        }
        out
    }

    /// Share of the full solid angle under which `q` sees the triangle, positive from behind.
    fn winding(&self, q: &Vector3<f32>) -> f32 {
        let a = (Vector3::from(self.a) - q).cast::<f64>();
        let (b, c) = (a + Vector3::from(self.ab).cast(), a + Vector3::from(self.ac).cast());
        let [la, lb, lc] = [a.norm(), b.norm(), c.norm()];
        let volume = a.dot(&b.cross(&c));
        let denominator = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        if volume == 0.0 { 0.0 } else { (volume.atan2(denominator) / std::f64::consts::TAU) as f32 }
    }

    fn moments(&self) -> Moments {
        let [a, ab, ac] = [self.a, self.ab, self.ac].map(Vector3::from);
        let area = ab.cross(&ac) * 0.5;
        let middle = a + (ab + ac) / 3.0;
        // The radius and the second moment of one triangle are never asked for: only nodes are.
        Moments { middle, area, size: area.norm(), radius: 0.0, second: [0.0; 6] }
    }
}

impl Moments {
    /// How far away, in radii, a group may be taken together.
    const FAR: f32 = 2.5;

    fn join(parts: &[Self], node: &Node) -> Self {
        let size: f32 = parts.iter().map(|m| m.size).sum();
        let middle = if size > 0.0 {
            parts.iter().map(|m| m.middle * m.size).sum::<Vector3<f32>>() / size
        } else {
            (Vector3::from(node.min) + Vector3::from(node.max)) * 0.5
        };
        let mut second = [0.0; 6];
        for m in parts {
            let (o, a) = (m.middle - middle, m.area);
            let shifted = [
                o.x * a.x,
                o.y * a.y,
                o.z * a.z,
                o.x * a.y + o.y * a.x,
                o.y * a.z + o.z * a.y,
                o.z * a.x + o.x * a.z,
            ];
            for k in 0..6 {
                second[k] += m.second[k] + shifted[k];
            }
        }
        let reach = (Vector3::from(node.max) - middle).sup(&(middle - Vector3::from(node.min)));
        Self { middle, area: parts.iter().map(|m| m.area).sum(), size, radius: reach.norm(), second }
    }

    /// The winding number of the group around `q`, where `q` is far enough.
    #[inline(always)]
    fn winding_from_afar(&self, q: &Vector3<f32>) -> Option<f32> {
        let r = self.middle - q;
        let r2 = r.norm_squared();
        if r2 <= Self::FAR * Self::FAR * self.radius * self.radius || r2 == 0.0 {
            return None;
        }
        let inv2 = 1.0 / r2;
        let inv3 = inv2 * inv2.sqrt();
        let [xx, yy, zz, xy, yz, zx] = self.second;
        let trace = xx + yy + zz;
        let along = xx * r.x * r.x + yy * r.y * r.y + zz * r.z * r.z + xy * r.x * r.y + yz * r.y * r.z + zx * r.z * r.x;
        Some((self.area.dot(&r) + trace - 3.0 * along * inv2) * inv3 / (2.0 * std::f32::consts::TAU))
    }
}

#[inline(always)]
fn clamp01(x: f32) -> f32 {
    // In this form one instruction each, and not a number becomes zero.
    let x = if x > 0.0 { x } else { 0.0 };
    if x < 1.0 { x } else { 1.0 }
}

#[inline(always)]
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Squared distances of eight points to a box.
#[inline(always)]
fn to_box(node: &Node, p: &Points) -> [f32; PACKET] {
    let mut out = [0.0; PACKET];
    for l in 0..PACKET {
        let mut d2 = 0.0;
        for k in 0..3 {
            let below = node.min[k] - p[k][l];
            let above = p[k][l] - node.max[k];
            let gap = if below > above { below } else { above };
            let gap = if gap > 0.0 { gap } else { 0.0 };
            d2 += gap * gap;
        }
        out[l] = d2;
    }
    out
}

/// Whether any lane is below its bound, and the least of all.
#[inline(always)]
fn any_below(d2: &[f32; PACKET], bound: &[f32; PACKET]) -> (bool, f32) {
    let mut any = false;
    let mut nearest = f32::INFINITY;
    for l in 0..PACKET {
        any |= d2[l] < bound[l];
        nearest = least(d2[l], nearest);
    }
    (any, nearest)
}

#[inline(always)]
fn try_facet(facets: &[Facet], n: u32, p: &Points, best: &mut Nearest) {
    let d2 = facets[n as usize].distance2(p);
    for l in 0..PACKET {
        let nearer = d2[l] < best.d2[l];
        best.d2[l] = if nearer { d2[l] } else { best.d2[l] };
        best.facet[l] = if nearer { n } else { best.facet[l] };
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn search(nodes: &[Node], facets: &[Facet], p: &Points, seeds: &[u32; PACKET], best: &mut Nearest) {
    for l in 0..PACKET {
        if !seeds[..l].contains(&seeds[l]) {
            try_facet(facets, seeds[l], p, best);
        }
    }
    let mut stack = [0u32; MAX_DEPTH];
    let mut bounds = [[0.0f32; PACKET]; MAX_DEPTH];
    let mut depth = 1;
    while depth > 0 {
        depth -= 1;
        let mut n = stack[depth] as usize;
        if !any_below(&bounds[depth], &best.d2).0 {
            continue;
        }
        loop {
            let node = &nodes[n];
            if node.count > 0 {
                for f in node.at..node.at + node.count {
                    try_facet(facets, f, p, best);
                }
                break;
            }
            let children = [n + 1, node.at as usize];
            let d2 = children.map(|c| to_box(&nodes[c], p));
            let [(first, near_first), (second, near_second)] = [any_below(&d2[0], &best.d2), any_below(&d2[1], &best.d2)];
            match (first, second) {
                (false, false) => break,
                (true, false) => n = children[0],
                (false, true) => n = children[1],
                (true, true) => {
                    let later = usize::from(near_first <= near_second);
                    stack[depth] = children[later] as u32;
                    bounds[depth] = d2[later];
                    depth += 1;
                    n = children[1 - later];
                }
            }
        }
    }
}

/// Nodes of a tree of `n` triangles.
fn tree_size(n: usize) -> usize {
    if n <= LEAF { 1 } else { 1 + tree_size(n / 2) + tree_size(n - n / 2) }
}

/// Builds the subtree of `order`, whose triangles begin at `first` in the finished order, in `nodes`, which begin at `base`.
fn build(order: &mut [u32], first: usize, corners: &[[Vector3<f32>; 3]], nodes: &mut [Node], base: usize) {
    let (mut low, mut high) = (Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY));
    let (mut inner_low, mut inner_high) = (low, high);
    let middle = |t: u32| {
        let [a, b, c] = corners[t as usize];
        a + b + c
    };
    for &t in order.iter() {
        for c in &corners[t as usize] {
            low = low.inf(c);
            high = high.sup(c);
        }
        let m = middle(t);
        inner_low = inner_low.inf(&m);
        inner_high = inner_high.sup(&m);
    }
    nodes[0] = Node { min: low.into(), max: high.into(), at: first as u32, count: order.len() as u32 };
    if order.len() <= LEAF {
        return;
    }
    let half = order.len() / 2;
    let axis = (inner_high - inner_low).imax();
    order.select_nth_unstable_by(half, |&s, &t| middle(s)[axis].total_cmp(&middle(t)[axis]).then(s.cmp(&t)));
    let n_left = tree_size(half);
    nodes[0].count = 0;
    nodes[0].at = (base + 1 + n_left) as u32;
    let (left, right) = order.split_at_mut(half);
    let (nodes_left, nodes_right) = nodes[1..].split_at_mut(n_left);
    let mut left = || build(left, first, corners, nodes_left, base + 1);
    let mut right = || build(right, first + half, corners, nodes_right, base + 1 + n_left);
    if half > SPLIT_AMONG_THREADS {
        rayon::join(left, right);
    } else {
        left();
        right();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A few roundings of coordinates of about a unit.
    const ROUND_OFF: f32 = 4e-6;

    /// A ball with bumps as a net of latitudes, facing outwards.
    fn bumpy(rings: u32) -> (Vec<Vector3<f32>>, Vec<[u32; 3]>) {
        let around = 2 * rings;
        let mut points = Vec::new();
        for i in 0..=rings {
            let polar = std::f32::consts::PI * i as f32 / rings as f32;
            for j in 0..around {
                let turn = std::f32::consts::TAU * j as f32 / around as f32;
                let r = 1.0 + 0.1 * (5.0 * polar).sin() * (7.0 * turn).cos();
                points.push(Vector3::new(polar.sin() * turn.cos(), polar.cos(), polar.sin() * turn.sin()) * r);
            }
        }
        let at = |i: u32, j: u32| i * around + j % around;
        let triangles = (0..rings)
            .flat_map(|i| (0..around).map(move |j| (i, j)))
            .flat_map(|(i, j)| [[at(i, j), at(i, j + 1), at(i + 1, j)], [at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]])
            .collect();
        (points, triangles)
    }

    fn lattice(n: usize) -> impl Iterator<Item = [Vector3<f32>; PACKET]> {
        (0..n * n * n).map(move |c| {
            let at = Vector3::new((c % n) as f32, (c / n % n) as f32, (c / (n * n)) as f32);
            std::array::from_fn(|l| {
                let within = Vector3::new((l & 1) as f32, (l >> 1 & 1) as f32, (l >> 2) as f32) * 0.5;
                (at + within).map(|x| 3.0 * x / n as f32 - 1.49)
            })
        })
    }

    #[test]
    fn the_tree_finds_the_least_of_all_distances_at_any_size() {
        let (points, triangles) = bumpy(12);
        for size in [1.0, 1e-6, 1e6f32] {
            let points: Vec<_> = points.iter().map(|p| p * size + Vector3::new(0.3, 0.0, 0.1) * size).collect();
            let tree = TriangleTree::new(&points, &triangles);
            let mut hint = None;
            for packet in lattice(8) {
                let packet = packet.map(|p| p * size);
                let found = tree.nearest(&packet, hint.as_ref());
                for (l, d) in tree.distances(&found).into_iter().enumerate() {
                    let all = tree.nearest_of_all(packet[l]);
                    assert!((d - all).abs() <= ROUND_OFF * size, "{d} but {all} at {:?}", packet[l]);
                }
                hint = Some(found);
            }
        }
    }

    #[test]
    fn far_groups_taken_together_leave_the_winding_number_an_integer() {
        /// Half is what would turn a sign.
        const MOST: f32 = 0.05;
        let (points, triangles) = bumpy(24);
        let tree = TriangleTree::new(&points, &triangles);
        let mut worst = 0.0f32;
        for p in lattice(10).flatten() {
            let (w, all) = (tree.winding(p), tree.winding_of_all(p));
            assert!((all - all.round()).abs() < 1e-3);
            worst = worst.max((w - all).abs());
        }
        println!("largest error of a winding number: {worst}");
        assert!(worst < MOST, "{worst}");
    }
}
