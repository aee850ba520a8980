//! The triangles of a solid in a tree of boxes, eight to a node, asked for exact distances and winding numbers.
//!
//! A bake asks millions of neighbouring points: each starts from the leaf in which its neighbour found its nearest
//! triangle, so that almost every box is dismissed at once, and eight boxes or triangles are looked at together.
//! Coordinates are taken to about a unit by a power of two, exactly, so that nothing under- or overflows for solids of
//! any size.

mod leaf;

use leaf::{Leaf, minus, norm2};
use multiversion::multiversion;
use nalgebra::{Matrix3, Vector3};

use crate::lanes::{F8, LANES, dot};

/// Below this many triangles a subtree is built by one thread.
const SPLIT_AMONG_THREADS: usize = 4096;
/// Children of up to this many triangles have boxes along their surface.
const MOST_ALIGNED: usize = 2048;
/// A few roundings of coordinates of about a unit.
const ROUND_OFF: f32 = 2e-6;
/// Mark of a child that is a leaf.
const LEAF: u32 = 1 << 31;
/// A child that is not there.
const NONE: u32 = u32::MAX;
/// Every level holds an eighth of the triangles of the one above, and each leaves at most seven children for later.
const MAX_STACK: usize = 8 * 12;

/// Eight boxes and what lies in them. Boxes lie along the surface they hold: a ball about a distant point meets many upright
/// boxes of a slanting surface, and few flat ones.
#[derive(Debug, Clone)]
struct Node {
    middle: [F8; 3],
    axes: [[F8; 3]; 3],
    /// Half the edges along the axes, and what rounding may take off a distance.
    half: [F8; 3],
    /// Node, leaf with [`LEAF`] set, or [`NONE`].
    child: [u32; LANES],
}

/// Sums over the triangles of each child of a node, for their solid angles seen from afar.
#[derive(Debug, Clone)]
struct Group {
    /// Mean position, weighted by area.
    middle: [F8; 3],
    /// Areas along the normals.
    area: [F8; 3],
    /// Products (position - middle) ⊗ area, symmetric part: xx, yy, zz, xy, yz, zx, each pair of the last three summed.
    second: [F8; 6],
    /// Squared distance from which the group may be taken together.
    far2: F8,
}

/// Triangles indexed for distances and solid angles.
#[derive(Debug, Clone)]
pub(crate) struct TriangleTree {
    nodes: Vec<Node>,
    groups: Vec<Group>,
    leaves: Vec<Leaf>,
    middle: Vector3<f32>,
    scale: f32,
    inv_scale: f32,
}

/// Points taken to the tree's coordinates together: as many as a row of a block.
const AT_ONCE: usize = 32;

/// Triangles near some place, for points that need not search the tree.
#[derive(Debug, Clone, Default)]
pub(crate) struct Nearby {
    packs: Vec<Leaf>,
    count: usize,
}

impl Nearby {
    /// Beyond four packs a search, which looks at seven and a dozen boxes, may be as fast.
    const MOST: usize = 4 * LANES;

    fn add(&mut self, leaf: &Leaf, lane: usize) {
        let to = self.count % LANES;
        if to == 0 {
            self.packs.push(leaf.clone());
        }
        if let Some(pack) = self.packs.last_mut() {
            // The first of a pack fills the lanes left over.
            let lanes = if to == 0 { 0..LANES } else { to..to + 1 };
            for (into, from) in pack.numbers_mut().into_iter().zip(leaf.numbers()) {
                into.0[lanes.clone()].fill(from.0[lane]);
            }
        }
        self.count += 1;
    }
}

/// Where to look first: the leaf in which a neighbour found what it is nearest to.
pub(crate) type Hint = u32;

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
        let corners: Vec<Corners> =
            triangles.iter().map(|t| t.map(|v| (points[v as usize] - middle) * scale)).collect();
        let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
        let mut leaves = Vec::with_capacity(triangles.len().div_ceil(LANES));
        split(&mut order, &corners);
        leaves.extend(order.chunks(LANES).map(|t| Leaf::new(t.iter().map(|&t| corners[t as usize]))));
        let mut tree = Self { nodes: Vec::new(), groups: Vec::new(), leaves, middle, scale, inv_scale: 1.0 / scale };
        tree.add_node(0, tree.leaves.len(), &order, &corners);
        tree
    }

    /// Makes a node of some leaves, which lie in order; returns it and what it holds.
    fn add_node(&mut self, first: usize, n_leaves: usize, order: &[u32], corners: &[Corners]) -> (u32, Child) {
        let here = self.nodes.len();
        self.nodes.push(Node::empty());
        self.groups.push(Group::empty());
        // The halves of the halves of the halves, as they were split.
        let mut parts = vec![(first, n_leaves)];
        for _ in 0..3 {
            parts = parts
                .into_iter()
                .flat_map(|(first, n)| {
                    let left = left_leaves(n);
                    [(first, left), (first + left, n - left)]
                })
                .filter(|part| part.1 > 0)
                .collect();
        }
        let mut children = Vec::with_capacity(LANES);
        for (lane, (first, n)) in parts.into_iter().enumerate() {
            let range = &order[first * LANES..((first + n) * LANES).min(order.len())];
            let (name, child) = if n == 1 {
                let triangles = range.iter().map(|&t| Child::of_triangle(&corners[t as usize]));
                (first as u32 | LEAF, Child::join(&triangles.collect::<Vec<_>>()))
            } else {
                self.add_node(first, n, order, corners)
            };
            self.nodes[here].set(lane, name, &child, range, corners);
            self.groups[here].set(lane, &child);
            children.push(child);
        }
        (here as u32, Child::join(&children))
    }

    /// A point (cm) in the tree's own coordinates.
    fn own(&self, p: Vector3<f32>) -> [f32; 3] {
        ((p - self.middle) * self.scale).into()
    }

    /// Distances of points (cm) that lie side by side; the last point's leaf is left in `hint` for the next.
    pub fn distances(&self, points: &[Vector3<f32>], hint: &mut Hint, out: &mut [f32]) {
        let mut own = [[0.0; 3]; AT_ONCE];
        for (points, out) in points.chunks(AT_ONCE).zip(out.chunks_mut(AT_ONCE)) {
            for (own, p) in own.iter_mut().zip(points) {
                *own = self.own(*p);
            }
            search(&self.nodes, &self.leaves, &own[..points.len()], hint, out);
            for d in out.iter_mut() {
                *d = d.sqrt() * self.inv_scale;
            }
        }
    }

    /// The triangles that any point may have nearest that lies within `reach` of `center`, which is at `distance` from the
    /// surface (cm); false where they are so many that a search is as good.
    pub fn gather(&self, center: Vector3<f32>, distance: f32, reach: f32, near: &mut Nearby) -> bool {
        // There is one within `distance + reach` of each point.
        let radius = (distance + 2.0 * reach) * self.scale * (1.0 + 16.0 * f32::EPSILON) + 4.0 * ROUND_OFF;
        near.count = 0;
        near.packs.clear();
        gather_in(&self.nodes, &self.leaves, &self.own(center), radius * radius, near);
        near.count <= Nearby::MOST
    }

    /// As [`Self::distances`], of points whose nearest triangles were gathered.
    pub fn distances_among(&self, near: &Nearby, points: &[Vector3<f32>], out: &mut [f32]) {
        let mut own = [[0.0; 3]; AT_ONCE];
        for (points, out) in points.chunks(AT_ONCE).zip(out.chunks_mut(AT_ONCE)) {
            for (own, p) in own.iter_mut().zip(points) {
                *own = self.own(*p);
            }
            least_among(&near.packs, &own[..points.len()], out);
            for d in out.iter_mut() {
                *d = d.sqrt() * self.inv_scale;
            }
        }
    }

    /// How often the surface winds around `p` (cm): an integer, up to the error of far groups taken together.
    pub fn winding(&self, p: Vector3<f32>) -> f32 {
        winding_in(&self.nodes, &self.groups, &self.leaves, &self.own(p))
    }

    /// The winding number by every triangle's solid angle: what [`Self::winding`] is compared with.
    #[cfg(test)]
    pub fn winding_of_all(&self, p: Vector3<f32>) -> f32 {
        let q = self.own(p);
        self.leaves.iter().map(|f| f.winding_plainly(&q)).sum::<f64>() as f32
    }

    /// The distance to every triangle in turn, the least taken: what [`Self::distances`] is compared with.
    #[cfg(test)]
    pub fn nearest_of_all(&self, p: Vector3<f32>) -> f32 {
        let own = self.own(p).map(F8::splat);
        let d2 = self.leaves.iter().map(|f| f.distance2(&own).least_lane()).fold(f32::INFINITY, f32::min);
        d2.sqrt() * self.inv_scale
    }
}

type Corners = [Vector3<f32>; 3];

/// Leaves of the left half: all full.
fn left_leaves(n_leaves: usize) -> usize {
    n_leaves.div_ceil(2)
}

/// Orders triangles so that every leaf, and every half of leaves at every level, lies together.
fn split(order: &mut [u32], corners: &[Corners]) {
    let n_leaves = order.len().div_ceil(LANES);
    if n_leaves <= 1 {
        return;
    }
    let middle = |t: u32| {
        let [a, b, c] = corners[t as usize];
        a + b + c
    };
    let (mut low, mut high) = (Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY));
    for &t in order.iter() {
        let m = middle(t);
        low = low.inf(&m);
        high = high.sup(&m);
    }
    let axis = (high - low).imax();
    let half = left_leaves(n_leaves) * LANES;
    if half < order.len() {
        order.select_nth_unstable_by(half, |&s, &t| middle(s)[axis].total_cmp(&middle(t)[axis]).then(s.cmp(&t)));
    }
    let (left, right) = order.split_at_mut(half);
    if half > SPLIT_AMONG_THREADS {
        rayon::join(|| split(left, corners), || split(right, corners));
    } else {
        split(left, corners);
        split(right, corners);
    }
}

/// What a child of a node holds.
struct Child {
    min: Vector3<f32>,
    max: Vector3<f32>,
    middle: Vector3<f32>,
    area: Vector3<f32>,
    /// Area without direction.
    size: f32,
    second: [f32; 6],
}

impl Child {
    fn of_triangle([a, b, c]: &Corners) -> Self {
        let area = (b - a).cross(&(c - a)) * 0.5;
        Self {
            min: a.inf(b).inf(c),
            max: a.sup(b).sup(c),
            middle: (a + b + c) / 3.0,
            area,
            size: area.norm(),
            // Positions of a triangle average to its middle.
            second: [0.0; 6],
        }
    }

    /// Axes along the surface as columns, the last its mean normal.
    fn axes(&self) -> Matrix3<f32> {
        let longest = (self.max - self.min).imax();
        let Some(normal) = self.area.try_normalize(f32::MIN_POSITIVE) else { return Matrix3::identity() };
        let mut along = Vector3::zeros();
        along[longest] = 1.0;
        let across = normal.cross(&along);
        // A surface that faces its box's longest way: any direction along it will do.
        let across =
            if across.norm_squared() > 0.01 { across } else { normal.cross(&Vector3::ith(normal.iamin(), 1.0)) };
        let across = across.normalize();
        Matrix3::from_columns(&[across.cross(&normal), across, normal])
    }

    fn join(parts: &[Self]) -> Self {
        let size: f32 = parts.iter().map(|m| m.size).sum();
        let (mut min, mut max) = (Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY));
        for part in parts {
            min = min.inf(&part.min);
            max = max.sup(&part.max);
        }
        let middle = if size > 0.0 {
            parts.iter().map(|m| m.middle * m.size).sum::<Vector3<f32>>() / size
        } else {
            (min + max) * 0.5
        };
        let mut second = [0.0; 6];
        for m in parts {
            let (o, a) = (m.middle - middle, m.area);
            let shifted =
                [o.x * a.x, o.y * a.y, o.z * a.z, o.x * a.y + o.y * a.x, o.y * a.z + o.z * a.y, o.z * a.x + o.x * a.z];
            for k in 0..6 {
                second[k] += m.second[k] + shifted[k];
            }
        }
        Self { min, max, middle, area: parts.iter().map(|m| m.area).sum(), size, second }
    }
}

impl Node {
    fn empty() -> Self {
        let zero = F8::ZERO;
        // Infinitely far from everything.
        let half = [F8::splat(f32::NEG_INFINITY); 3];
        Self { middle: [zero; 3], axes: [[zero; 3]; 3], half, child: [NONE; LANES] }
    }

    /// Puts a child with these triangles into a lane.
    fn set(&mut self, lane: usize, name: u32, child: &Child, triangles: &[u32], corners: &[Corners]) {
        let axes = if triangles.len() <= MOST_ALIGNED { child.axes() } else { Matrix3::identity() };
        let (mut low, mut high) = (child.min, child.max);
        if triangles.len() <= MOST_ALIGNED {
            (low, high) = (Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY));
            for c in triangles.iter().flat_map(|&t| &corners[t as usize]) {
                let c = axes.tr_mul(c);
                low = low.inf(&c);
                high = high.sup(&c);
            }
        }
        let middle = axes * ((low + high) * 0.5);
        let half = (high - low) * 0.5;
        for k in 0..3 {
            self.middle[k].0[lane] = middle[k];
            self.half[k].0[lane] = half[k] + ROUND_OFF;
            for n in 0..3 {
                self.axes[k][n].0[lane] = axes[(n, k)];
            }
        }
        self.child[lane] = name;
    }

    /// Squared distances of a point to the boxes.
    #[inline(always)]
    fn distance2(&self, p: &[F8; 3]) -> F8 {
        let r = minus(p, &self.middle);
        let [x, y, z] = &self.axes;
        let gap = |along: F8, half: F8| along.zip(along, |a, _| a.abs()) - half;
        norm2(&[
            gap(dot(*x, r), self.half[0]).greatest(F8::ZERO),
            gap(dot(*y, r), self.half[1]).greatest(F8::ZERO),
            gap(dot(*z, r), self.half[2]).greatest(F8::ZERO),
        ])
    }
}

impl Group {
    /// How far away, in radii, a group may be taken together.
    const FAR: f32 = 2.5;

    fn empty() -> Self {
        let zero = F8::ZERO;
        Self { middle: [zero; 3], area: [zero; 3], second: [zero; 6], far2: F8::splat(-1.0) }
    }

    fn set(&mut self, lane: usize, child: &Child) {
        let reach = (child.max - child.middle).sup(&(child.middle - child.min));
        for k in 0..3 {
            self.middle[k].0[lane] = child.middle[k];
            self.area[k].0[lane] = child.area[k];
        }
        for k in 0..6 {
            self.second[k].0[lane] = child.second[k];
        }
        self.far2.0[lane] = Self::FAR * Self::FAR * reach.norm_squared();
    }

    /// Winding numbers of the groups around `q`, of a dipole and a quadrupole each, and the lanes that are too near.
    #[inline(always)]
    fn winding(&self, q: &[F8; 3]) -> (F8, u8) {
        let r = [self.middle[0] - q[0], self.middle[1] - q[1], self.middle[2] - q[2]];
        let r2 = dot(r, r);
        let near = !self.far2.less(r2);
        let inv2 = r2.zip(self.far2, |r2, far2| if r2 > far2 && r2 > 0.0 { 1.0 / r2 } else { 0.0 });
        let inv3 = inv2.zip(inv2, |a, b| a * b.sqrt());
        let [xx, yy, zz, xy, yz, zx] = self.second;
        let along = dot([xx, yy, zz], [r[0] * r[0], r[1] * r[1], r[2] * r[2]])
            + dot([xy, yz, zx], [r[0] * r[1], r[1] * r[2], r[2] * r[0]]);
        let sum = dot(self.area, r) + xx + yy + zz - F8::splat(3.0) * along * inv2;
        (sum * inv3 * F8::splat(0.5 / std::f32::consts::TAU), near)
    }
}

/// Squared distances of points to the nearest triangle; all in the tree's own coordinates.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn search(nodes: &[Node], leaves: &[Leaf], points: &[[f32; 3]], hint: &mut Hint, out: &mut [f32]) {
    let mut stack = [(0.0f32, 0u32); MAX_STACK];
    for (point, out) in points.iter().zip(out) {
        let p = [F8::splat(point[0]), F8::splat(point[1]), F8::splat(point[2])];
        let mut best = f32::INFINITY;
        stack[0] = (0.0, 0);
        stack[1] = (0.0, *hint | LEAF);
        let mut depth = 2;
        while depth > 0 {
            depth -= 1;
            let (bound, n) = stack[depth];
            if bound >= best {
                continue;
            }
            if n & LEAF != 0 {
                let d2 = leaves[(n & !LEAF) as usize].distance2(&p);
                let mut nearer = d2.less(F8::splat(best));
                if nearer != 0 {
                    *hint = n & !LEAF;
                }
                while nearer != 0 {
                    let d2 = d2.0[nearer.trailing_zeros() as usize];
                    best = if d2 < best { d2 } else { best };
                    nearer &= nearer - 1;
                }
                continue;
            }
            let node = &nodes[n as usize];
            let d2 = node.distance2(&p);
            let mut within = d2.less(F8::splat(best));
            let bottom = depth;
            while within != 0 {
                let lane = within.trailing_zeros() as usize;
                within &= within - 1;
                // The nearest on top.
                let entry = (d2.0[lane], node.child[lane]);
                let mut at = depth;
                while at > bottom && stack[at - 1].0 < entry.0 {
                    stack[at] = stack[at - 1];
                    at -= 1;
                }
                stack[at] = entry;
                depth += 1;
            }
        }
        *out = best;
    }
}

/// Adds the triangles within a ball, until they are too many.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn gather_in(nodes: &[Node], leaves: &[Leaf], center: &[f32; 3], radius2: f32, near: &mut Nearby) {
    let p = [F8::splat(center[0]), F8::splat(center[1]), F8::splat(center[2])];
    let limit = F8::splat(radius2);
    let mut stack = [0u32; MAX_STACK];
    let mut depth = 1;
    while depth > 0 {
        depth -= 1;
        let n = stack[depth];
        if n & LEAF != 0 {
            let leaf = &leaves[(n & !LEAF) as usize];
            let mut within = leaf.distance2(&p).less(limit);
            while within != 0 {
                let lane = within.trailing_zeros() as usize;
                within &= within - 1;
                if lane < leaf.count {
                    near.add(leaf, lane);
                }
            }
            if near.count > Nearby::MOST {
                return;
            }
            continue;
        }
        let node = &nodes[n as usize];
        let mut within = node.distance2(&p).less(limit);
        while within != 0 {
            let lane = within.trailing_zeros() as usize;
            within &= within - 1;
            stack[depth] = node.child[lane];
            depth += 1;
        }
    }
}

/// Squared distances of points to the nearest of some triangles, of which there must be one.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn least_among(packs: &[Leaf], points: &[[f32; 3]], out: &mut [f32]) {
    for (point, out) in points.iter().zip(out) {
        let p = [F8::splat(point[0]), F8::splat(point[1]), F8::splat(point[2])];
        let mut least = F8::splat(f32::INFINITY);
        for pack in packs {
            least = pack.distance2(&p).least(least);
        }
        let v = least.0;
        let lesser = |a: f32, b: f32| if a < b { a } else { b };
        let four = [lesser(v[0], v[4]), lesser(v[1], v[5]), lesser(v[2], v[6]), lesser(v[3], v[7])];
        *out = lesser(lesser(four[0], four[2]), lesser(four[1], four[3]));
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn winding_in(nodes: &[Node], groups: &[Group], leaves: &[Leaf], q: &[f32; 3]) -> f32 {
    let p = [F8::splat(q[0]), F8::splat(q[1]), F8::splat(q[2])];
    let mut stack = [0u32; MAX_STACK];
    let mut depth = 1;
    let mut sum = 0.0f32;
    while depth > 0 {
        depth -= 1;
        let n = stack[depth] as usize;
        let (from_afar, mut near) = groups[n].winding(&p);
        for w in from_afar.0 {
            sum += w;
        }
        while near != 0 {
            let lane = near.trailing_zeros() as usize;
            near &= near - 1;
            let child = nodes[n].child[lane];
            if child == NONE {
                continue;
            }
            if child & LEAF != 0 {
                sum += leaves[(child & !LEAF) as usize].winding(q);
            } else {
                stack[depth] = child;
                depth += 1;
            }
        }
    }
    sum
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

    fn lattice(n: usize) -> impl Iterator<Item = [Vector3<f32>; LANES]> {
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
            let mut hint = 0;
            for packet in lattice(8) {
                let packet = packet.map(|p| p * size);
                let mut found = [0.0; 8];
                tree.distances(&packet, &mut hint, &mut found);
                for (l, d) in found.into_iter().enumerate() {
                    let all = tree.nearest_of_all(packet[l]);
                    assert!((d - all).abs() <= ROUND_OFF * size, "{d} but {all} at {:?}", packet[l]);
                }
            }
        }
    }

    #[test]
    fn triangles_gathered_about_a_place_hold_the_nearest_of_every_point_there() {
        let (points, triangles) = bumpy(12);
        for size in [1.0, 1e-6, 1e6f32] {
            let points: Vec<_> = points.iter().map(|p| p * size).collect();
            let tree = TriangleTree::new(&points, &triangles);
            let (mut hint, mut near) = (0, Nearby::default());
            let mut gathered = 0;
            for packet in lattice(12) {
                let packet = packet.map(|p| p * size);
                let center = packet.iter().sum::<Vector3<f32>>() / 8.0;
                let reach = packet.iter().map(|p| (p - center).norm()).fold(0.0, f32::max);
                if !tree.gather(center, tree.nearest_of_all(center), reach, &mut near) {
                    continue;
                }
                gathered += 1;
                let (mut searched, mut among) = ([0.0; 8], [0.0; 8]);
                tree.distances(&packet, &mut hint, &mut searched);
                tree.distances_among(&near, &packet, &mut among);
                assert_eq!(searched, among, "the same triangle, the same arithmetic");
            }
            assert!(gathered > 500, "hardly tried: {gathered}");
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
        assert!(worst < MOST, "{worst}");
    }
}
