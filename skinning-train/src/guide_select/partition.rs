//! A graph cut into parts of like size with little weight between them: multilevel recursive bisection, then refinement of
//! all parts at once (after Karypis and Kumar 1998).
//!
//! Chai et al. 2014 use METIS. Its packaged sources draw from the C library's global random state, so that a cut depends on
//! the platform and on who else draws; this one is a function of the graph and the seed. Weights are integers: sums have no
//! order. Every part gets at least one vertex, and at most [`MOST_OVER`] times its share as far as vertices allow.

use std::collections::BinaryHeap;

use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Largest part over the mean.
pub const MOST_OVER: f64 = 1.1;
/// Vertices that coarsening stops at.
const COARSEST: usize = 60;
/// Coarsening that keeps more than this share of the vertices has come to its end.
const LEAST_SHRINKING: f64 = 0.95;
/// Bisections grown on the coarsest graph; the best is kept.
const GROWN: usize = 8;
/// Rounds of moves at each level of a bisection, and of all parts at the end.
const ROUNDS: usize = 8;
/// Moves that may go by without a better cut before a round of a bisection ends.
const PATIENCE: usize = 100;

/// An undirected graph in CSR form with integer weights: every edge is there from both ends.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct WeightedGraph {
    /// `n + 1` offsets into the edges.
    pub start: Vec<u32>,
    /// Per edge, the vertex at its other end.
    pub end: Vec<u32>,
    /// Per edge, its weight.
    pub weight: Vec<u32>,
}

impl WeightedGraph {
    /// The graph of `n` vertices with the given edges `(a, b, weight)`, each once, from either end.
    ///
    /// # Panics
    /// If an edge names a vertex that is not there.
    #[must_use]
    pub fn from_edges(n: usize, edges: &[(u32, u32, u32)]) -> Self {
        let mut start = vec![0_u32; n + 1];
        for &(a, b, _) in edges {
            start[a as usize + 1] += 1;
            start[b as usize + 1] += 1;
        }
        (0..n).for_each(|v| start[v + 1] += start[v]);
        let mut next = start.clone();
        let (mut end, mut weight) = (vec![0; 2 * edges.len()], vec![0; 2 * edges.len()]);
        for &(a, b, w) in edges {
            for (from, to) in [(a, b), (b, a)] {
                let at = &mut next[from as usize];
                (end[*at as usize], weight[*at as usize]) = (to, w);
                *at += 1;
            }
        }
        Self { start, end, weight }
    }

    /// Number of vertices.
    #[must_use]
    pub fn n_vertices(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    /// Neighbours of a vertex with the weights of the edges to them.
    ///
    /// # Panics
    /// If there is no such vertex.
    pub fn edges(&self, v: usize) -> impl Iterator<Item = (usize, u32)> + '_ {
        let range = self.start[v] as usize..self.start[v + 1] as usize;
        self.end[range.clone()].iter().map(|&e| e as usize).zip(self.weight[range].iter().copied())
    }

    /// Weight of all edges between different parts.
    ///
    /// # Panics
    /// If there is a vertex without a part.
    #[must_use]
    pub fn cut(&self, part: &[u32]) -> u64 {
        let all = (0..self.n_vertices()).flat_map(|v| self.edges(v).map(move |(e, w)| (v, e, w)));
        all.filter(|&(v, e, _)| part[v] != part[e]).map(|(_, _, w)| u64::from(w)).sum::<u64>() / 2
    }
}

/// The part of every vertex, 0 to `n_parts - 1`; none is empty.
///
/// # Panics
/// If there are fewer vertices than parts, or no parts.
#[must_use]
pub fn partition(graph: &WeightedGraph, n_parts: usize, seed: u64) -> Vec<u32> {
    let n = graph.n_vertices();
    assert!(n_parts >= 1 && n_parts <= n, "{n} vertices cannot be cut into {n_parts} parts");
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut part = vec![0; n];
    // What a part may be over its share, spread over the bisections it comes from.
    let over = MOST_OVER.powf(1.0 / (n_parts as f64).log2().ceil().max(1.0));
    // Parts still to be cut: their vertices, the first part's number and how many there are to be.
    let mut open = vec![((0..n as u32).collect::<Vec<u32>>(), 0_u32, n_parts)];
    while let Some((vertices, first, k)) = open.pop() {
        if k == 1 {
            vertices.iter().for_each(|&v| part[v as usize] = first);
            continue;
        }
        let k_left = k / 2;
        let level = Level::of_part(graph, &vertices);
        let side = bisect(&level, Bounds::new(level.n() as u64, k_left, k, over), &mut rng);
        let of_side =
            |wanted: bool| vertices.iter().zip(&side).filter(|(_, s)| **s == wanted).map(|(&v, _)| v).collect();
        open.push((of_side(false), first + k_left as u32, k - k_left));
        open.push((of_side(true), first, k_left));
    }
    refine_parts(graph, n_parts, &mut part);
    part
}

/// A graph whose vertices stand for several of the graph it was made from.
struct Level {
    graph: Vec<Vec<(u32, u64)>>,
    size: Vec<u64>,
}

impl Level {
    /// The part of the graph on `vertices`, ascending.
    fn of_part(graph: &WeightedGraph, vertices: &[u32]) -> Self {
        let within = |&v: &u32| {
            let all = graph.edges(v as usize);
            all.filter_map(|(e, w)| Some((vertices.binary_search(&(e as u32)).ok()? as u32, u64::from(w)))).collect()
        };
        Self { graph: vertices.iter().map(within).collect(), size: vec![1; vertices.len()] }
    }

    fn n(&self) -> usize {
        self.size.len()
    }

    /// Pairs of vertices joined along heavy edges, and for each vertex the one it went into; `None` where little would be gained.
    fn coarser(&self, rng: &mut Pcg64Mcg) -> Option<(Self, Vec<u32>)> {
        const FREE: u32 = u32::MAX;
        let n = self.n();
        let total: u64 = self.size.iter().sum();
        // Vertices that grow too large leave no balanced bisection.
        let largest = (3 * total).div_ceil(2 * COARSEST as u64).max(2);
        let mut order: Vec<usize> = (0..n).collect();
        order.shuffle(rng);
        let mut into = vec![FREE; n];
        let mut n_coarse = 0;
        for v in order {
            if into[v] != FREE {
                continue;
            }
            let fits = |e: u32| into[e as usize] == FREE && self.size[v] + self.size[e as usize] <= largest;
            let heaviest = self.graph[v].iter().filter(|e| fits(e.0)).max_by_key(|e| (e.1, std::cmp::Reverse(e.0)));
            if let Some(&(mate, _)) = heaviest {
                into[mate as usize] = n_coarse;
            }
            into[v] = n_coarse;
            n_coarse += 1;
        }
        if n_coarse as f64 > LEAST_SHRINKING * n as f64 {
            return None;
        }
        let mut coarse = Self { graph: vec![Vec::new(); n_coarse as usize], size: vec![0; n_coarse as usize] };
        for v in 0..n {
            let to = into[v] as usize;
            coarse.size[to] += self.size[v];
            let edges = self.graph[v].iter().map(|&(e, w)| (into[e as usize], w));
            coarse.graph[to].extend(edges.filter(|e| e.0 as usize != to));
        }
        for edges in &mut coarse.graph {
            edges.sort_unstable_by_key(|e| e.0);
            edges.dedup_by(|e, kept| {
                let same = e.0 == kept.0;
                if same {
                    kept.1 += e.1;
                }
                same
            });
        }
        Some((coarse, into))
    }

    fn cut(&self, side: &[bool]) -> u64 {
        let all = self.graph.iter().enumerate();
        all.map(|(v, edges)| edges.iter().filter(|e| side[v] != side[e.0 as usize]).map(|e| e.1).sum::<u64>())
            .sum::<u64>()
            / 2
    }

    /// What moving `v` to the other side takes off the cut.
    fn gain(&self, v: usize, side: &[bool]) -> i64 {
        self.graph[v].iter().map(|&(e, w)| if side[e as usize] == side[v] { -(w as i64) } else { w as i64 }).sum()
    }
}

/// How many vertices may lie on the left.
#[derive(Clone, Copy)]
struct Bounds {
    least: u64,
    wanted: u64,
    most: u64,
}

impl Bounds {
    /// Of `n` vertices to be cut into `k` parts, `k_left` of them left, each side up to `over` times its share.
    fn new(n: u64, k_left: usize, k: usize, over: f64) -> Self {
        let share = n as f64 * k_left as f64 / k as f64;
        let slack = share.min(n as f64 - share) * (over - 1.0);
        let wanted = (share.round() as u64).clamp(k_left as u64, n - (k - k_left) as u64);
        let least = ((share - slack).ceil() as u64).clamp(k_left as u64, wanted);
        let most = ((share + slack).floor() as u64).clamp(wanted, n - (k - k_left) as u64);
        Self { least, wanted, most }
    }

    /// How far a size is from allowed.
    fn excess(self, left: u64) -> u64 {
        self.least.saturating_sub(left).max(left.saturating_sub(self.most))
    }
}

/// True for vertices on the left.
fn bisect(finest: &Level, bounds: Bounds, rng: &mut Pcg64Mcg) -> Vec<bool> {
    let mut levels: Vec<(Level, Vec<u32>)> = Vec::new();
    loop {
        let now = levels.last().map_or(finest, |l| &l.0);
        if now.n() <= COARSEST {
            break;
        }
        let Some(next) = now.coarser(rng) else { break };
        levels.push(next);
    }
    let coarsest = levels.last().map_or(finest, |l| &l.0);
    let mut best: Option<(u64, u64, Vec<bool>)> = None;
    for _ in 0..GROWN {
        let mut side = grow(coarsest, bounds, rng.random_range(0..coarsest.n()));
        refine(coarsest, bounds, &mut side);
        let found = (bounds.excess(size_of(coarsest, &side)), coarsest.cut(&side));
        if best.as_ref().is_none_or(|b| found < (b.0, b.1)) {
            best = Some((found.0, found.1, side));
        }
    }
    let mut side = best.map_or_else(Vec::new, |b| b.2);
    while let Some((_, into)) = levels.pop() {
        side = into.iter().map(|&c| side[c as usize]).collect();
        refine(levels.last().map_or(finest, |l| &l.0), bounds, &mut side);
    }
    side
}

fn size_of(level: &Level, side: &[bool]) -> u64 {
    level.size.iter().zip(side).filter(|s| *s.1).map(|s| s.0).sum()
}

/// A left side grown from one vertex along what cuts least, up to its wanted size.
fn grow(level: &Level, bounds: Bounds, from: usize) -> Vec<bool> {
    let n = level.n();
    let mut side = vec![false; n];
    let mut size = 0;
    let mut heap = BinaryHeap::from([(0_i64, std::cmp::Reverse(from))]);
    let mut unseen = 0;
    while size < bounds.wanted {
        let v = match heap.pop() {
            Some((gain, std::cmp::Reverse(v))) => {
                if side[v] || (size > 0 && gain != level.gain(v, &side)) {
                    continue;
                }
                v
            }
            // This component is used up: go on with any vertex.
            None => {
                while unseen < n && side[unseen] {
                    unseen += 1;
                }
                unseen
            }
        };
        if v >= n {
            break;
        }
        side[v] = true;
        size += level.size[v];
        for &(e, _) in &level.graph[v] {
            if !side[e as usize] {
                heap.push((level.gain(e as usize, &side), std::cmp::Reverse(e as usize)));
            }
        }
    }
    side
}

/// Moves single vertices, the best first, also through worse cuts, and keeps the best seen (Fiduccia and Mattheyses 1982).
fn refine(level: &Level, bounds: Bounds, side: &mut [bool]) {
    let n = level.n();
    let mut size = size_of(level, side);
    for _ in 0..ROUNDS {
        let mut gain: Vec<i64> = (0..n).map(|v| level.gain(v, side)).collect();
        let mut moved = vec![false; n];
        // One heap of vertices on the right, one of those on the left; entries whose gain is not the present one are old.
        let mut heaps = [BinaryHeap::new(), BinaryHeap::new()];
        let off_balance = bounds.excess(size) > 0;
        for v in 0..n {
            if off_balance || level.graph[v].iter().any(|e| side[e.0 as usize] != side[v]) {
                heaps[usize::from(side[v])].push((gain[v], std::cmp::Reverse(v)));
            }
        }
        let mut done: Vec<usize> = Vec::new();
        let (mut change, mut best) = (0_i64, (bounds.excess(size), 0_i64, 0_usize));
        while done.len() - best.2 <= PATIENCE {
            for (of, heap) in heaps.iter_mut().enumerate() {
                while heap
                    .peek()
                    .is_some_and(|&(g, std::cmp::Reverse(v))| moved[v] || g != gain[v] || usize::from(side[v]) != of)
                {
                    heap.pop();
                }
            }
            // Where both sides may give, the larger gain; a side off its bounds must give or get.
            let after = |from_left: bool, v: usize| {
                if from_left { size - level.size[v] } else { size + level.size[v] }
            };
            let mut choice: Option<(u64, i64, usize)> = None;
            for from_left in [false, true] {
                let Some(&(g, std::cmp::Reverse(v))) = heaps[usize::from(from_left)].peek() else { continue };
                let excess = bounds.excess(after(from_left, v));
                if excess > 0 && excess >= bounds.excess(size) {
                    continue;
                }
                if choice.is_none_or(|(e, best, _)| (excess, -g) < (e, -best)) {
                    choice = Some((excess, g, v));
                }
            }
            let Some((_, g, v)) = choice else { break };
            size = after(side[v], v);
            side[v] = !side[v];
            moved[v] = true;
            done.push(v);
            change -= g;
            for &(e, w) in &level.graph[v] {
                let e = e as usize;
                let w = w as i64;
                gain[e] += if side[e] == side[v] { -2 * w } else { 2 * w };
                if !moved[e] {
                    heaps[usize::from(side[e])].push((gain[e], std::cmp::Reverse(e)));
                }
            }
            let excess = bounds.excess(size);
            if (excess, change) < (best.0, best.1) {
                best = (excess, change, done.len());
            }
        }
        for &v in done[best.2..].iter().rev() {
            size = if side[v] { size - level.size[v] } else { size + level.size[v] };
            side[v] = !side[v];
        }
        if best.2 == 0 {
            break;
        }
    }
}

/// Moves vertices between any parts while that takes weight off the cut and no part grows too large or empty.
fn refine_parts(graph: &WeightedGraph, n_parts: usize, part: &mut [u32]) {
    let n = graph.n_vertices();
    let mut size = vec![0_usize; n_parts];
    part.iter().for_each(|&p| size[p as usize] += 1);
    let share = n as f64 / n_parts as f64;
    let most = ((share * MOST_OVER).floor() as usize).max(share.ceil() as usize);
    let mut to_part: Vec<(u32, u64)> = Vec::new();
    for _ in 0..ROUNDS {
        let mut any = false;
        for v in 0..n {
            let own = part[v];
            to_part.clear();
            for (e, w) in graph.edges(v) {
                match to_part.iter_mut().find(|p| p.0 == part[e]) {
                    Some(p) => p.1 += u64::from(w),
                    None => to_part.push((part[e], u64::from(w))),
                }
            }
            let kept = to_part.iter().find(|p| p.0 == own).map_or(0, |p| p.1);
            let target = to_part.iter().filter(|p| p.0 != own && size[p.0 as usize] < most);
            let target = target.max_by_key(|p| (p.1, std::cmp::Reverse(p.0)));
            if let Some(&(to, weight)) = target
                && size[own as usize] > 1
                && (weight > kept || (weight == kept && size[to as usize] + 1 < size[own as usize]))
            {
                size[own as usize] -= 1;
                size[to as usize] += 1;
                part[v] = to;
                any = true;
            }
        }
        if !any {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cut of a grid over the shortest there is: greedy choices leave some steps in the borders.
    const MOST_OVER_SHORTEST: f64 = 1.25;
    /// A random partition cuts 1 - 1/k of all edges; any sense of place does far better.
    const LEAST_BETTER_THAN_RANDOM: f64 = 3.0;

    fn grid(w: u32, h: u32) -> WeightedGraph {
        let mut edges = Vec::new();
        for y in 0..h {
            for x in 0..w {
                let v = y * w + x;
                if x + 1 < w {
                    edges.push((v, v + 1, 1));
                }
                if y + 1 < h {
                    edges.push((v, v + w, 1));
                }
            }
        }
        WeightedGraph::from_edges((w * h) as usize, &edges)
    }

    fn random_graph(n: u32, degree: u32, seed: u64) -> WeightedGraph {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let place: Vec<[f64; 2]> = (0..n).map(|_| [rng.random(), rng.random()]).collect();
        let reach = (f64::from(degree) / (std::f64::consts::PI * f64::from(n))).sqrt();
        let mut edges = Vec::new();
        for a in 0..n {
            for b in a + 1..n {
                let d = (0..2).map(|c| (place[a as usize][c] - place[b as usize][c]).powi(2)).sum::<f64>().sqrt();
                if d < reach {
                    edges.push((a, b, 1 + (1000.0 * (1.0 - d / reach)) as u32));
                }
            }
        }
        WeightedGraph::from_edges(n as usize, &edges)
    }

    fn sizes(part: &[u32], k: usize) -> Vec<usize> {
        (0..k).map(|p| part.iter().filter(|&&x| x as usize == p).count()).collect()
    }

    #[test]
    fn every_part_has_vertices_and_none_too_many() {
        for (n, k) in [(1500, 2), (1500, 7), (1500, 100), (1500, 400), (300, 299), (300, 300), (300, 1)] {
            let part = partition(&random_graph(n, 10, 4), k, 1);
            let sizes = sizes(&part, k);
            assert_eq!(sizes.iter().sum::<usize>(), n as usize, "every vertex is in one part");
            let share = f64::from(n) / k as f64;
            // Whole vertices: a part of few cannot keep to a tenth.
            let most = (share * MOST_OVER).max(share.ceil() + 1.0);
            assert!(sizes.iter().all(|&s| s >= 1 && s as f64 <= most), "{n} in {k}: {sizes:?}");
        }
    }

    #[test]
    fn grids_are_cut_along_short_lines() {
        for (w, h, k, shortest) in [(16, 16, 2, 16), (32, 8, 4, 24), (16, 16, 4, 32), (60, 40, 6, 160)] {
            let graph = grid(w, h);
            let cut = graph.cut(&partition(&graph, k, 3));
            assert!(cut as f64 <= MOST_OVER_SHORTEST * f64::from(shortest), "{w} x {h} in {k}: {cut}, {shortest} do");
        }
    }

    #[test]
    fn groups_that_hang_together_by_a_thread_are_parted_there() {
        // Five complete groups of twenty, each tied to the next by one light edge.
        let mut edges = Vec::new();
        for g in 0..5_u32 {
            for a in 0..20 {
                (a + 1..20).for_each(|b| edges.push((20 * g + a, 20 * g + b, 10)));
            }
            if g > 0 {
                edges.push((20 * g - 1, 20 * g, 1));
            }
        }
        let graph = WeightedGraph::from_edges(100, &edges);
        assert_eq!(graph.cut(&partition(&graph, 5, 1)), 4);
    }

    #[test]
    fn the_cut_is_far_below_a_random_one() {
        let graph = random_graph(2000, 12, 9);
        let part = partition(&graph, 50, 1);
        let mut random = part.clone();
        random.shuffle(&mut Pcg64Mcg::seed_from_u64(5));
        let (ours, random) = (graph.cut(&part), graph.cut(&random));
        assert!(LEAST_BETTER_THAN_RANDOM * ours as f64 <= random as f64, "{ours}, at random {random}");
    }

    #[test]
    fn vertices_without_edges_are_spread() {
        let part = partition(&WeightedGraph::from_edges(40, &[(0, 1, 5), (2, 3, 5)]), 8, 1);
        assert!(sizes(&part, 8).iter().all(|&s| (1..=6).contains(&s)), "{part:?}");
        assert!(part[0] == part[1] && part[2] == part[3]);
    }
}
