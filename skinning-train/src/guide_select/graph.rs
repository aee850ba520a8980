//! Guides by a graph of which strands move alike: Chai et al. 2014, the method AS16 §6.3 compares with (Fig. 9).
//!
//! Particles near each other in more than a fifth of the frames share an edge whose weight falls with how differently they
//! move; the edge of two strands is the sum over their particles. The graph is cut into as many parts as guides
//! ([`super::partition`]); in each part the strand becomes guide that has most edge weight to strands that are not guides.
//!
//! Ours, where the paper is not at hand or would not scale: only equal particles of two strands are paired, as skinning pairs
//! them; B translates; a strand has edges to a limited number of others, found on a few frames; the reach follows the
//! density of roots. Frames are streamed; sums come in order of frames: same bytes for any number of threads.

use io_formats::{FrameSource, UniformGroom};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::near::{NOBODY, nearest_other, nearest_within, squared_distance};
use super::partition::{WeightedGraph, partition};
use crate::error::Result;

/// Frames, spread evenly, on which strands look for neighbours.
const PROBED_FRAMES: usize = 6;
/// Neighbours of a particle that are taken note of in such a frame.
const NOTED: usize = 8;
/// Candidates a strand keeps from one such frame to the next.
const KEPT: usize = 64;
/// Nearest roots this near (cm) count as one place.
const LEAST_SPACING_CM: f32 = 1e-3;
/// Weight of the heaviest edge; the least is 1.
const LARGEST_WEIGHT: f64 = 1e6;
/// Pairs treated by one task.
const PAIRS_AT_ONCE: usize = 1024;

/// How the graph is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GraphParams {
    /// Particles are near within this multiple of the median distance from a root to the nearest other: at 4, roots spread
    /// evenly have about twelve others near.
    pub radius_factor: f64,
    /// Share of the frames that particles must be near in, more than.
    pub near_share: f64,
    /// Strands that a strand may choose as neighbours; those that choose it come on top.
    pub max_neighbours: usize,
}

impl GraphParams {
    /// The share of Chai et al. 2014, a fifth, with a reach and a limit of ours.
    #[must_use]
    pub fn standard() -> Self {
        Self { radius_factor: 4.0, near_share: 0.2, max_neighbours: 16 }
    }
}

/// Guides and the parts they stand for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct GuideParts {
    /// The strand of each guide, ascending.
    pub guide_strands: Vec<u32>,
    /// The part of each strand, numbered as the guides are.
    pub part: Vec<u32>,
    /// For each part, the parts that edges lead to, the heaviest connection first.
    pub adjacent: Vec<Vec<u32>>,
}

/// Chooses `n_guides` guides and their parts. `on_frame` hears of every frame read.
///
/// # Errors
/// When a frame cannot be read.
///
/// # Panics
/// If there are fewer strands than guides, or `rest` (cm, head frame) is not the hair of the frames.
pub fn graph_guides(
    frames: &dyn FrameSource,
    rest: &UniformGroom,
    n_guides: usize,
    params: &GraphParams,
    seed: u64,
    on_frame: &mut dyn FnMut(u64),
) -> Result<GuideParts> {
    let graph = motion_graph(frames, rest, params, on_frame)?;
    let part = partition(&graph, n_guides, seed);
    let guides = guides_of_parts(&graph, &part, n_guides);
    Ok(numbered_by_guide(&graph, part, guides))
}

/// The graph of strands that are near and move alike; the heaviest edge weighs a million, none less than 1.
/// A strand without edges is tied by the least weight to the one rooted nearest.
///
/// # Errors
/// When a frame cannot be read.
pub fn motion_graph(
    frames: &dyn FrameSource,
    rest: &UniformGroom,
    params: &GraphParams,
    on_frame: &mut dyn FnMut(u64),
) -> Result<WeightedGraph> {
    let n = rest.n_particles;
    let roots: Vec<[f32; 3]> = rest.points.chunks_exact(n).map(|s| s[0]).collect();
    let reach = (params.radius_factor * f64::from(root_spacing(&roots))) as f32;
    let pairs = candidate_pairs(frames, reach, params.max_neighbours)?;
    let sums = motion_sums(frames, rest, reach, &pairs, on_frame)?;

    // Weight of a particle edge: -Σ_f(|B_i s̄_j - s_j|² + |B_j s̄_i - s_i|²), shifted by the largest so that none is negative.
    // With translations both squares are that of the difference of displacements, so their double is left out.
    let least_frames = params.near_share * frames.n_frames() as f64;
    let is_edge = |sum: &PairSum| f64::from(sum.near) > least_frames;
    let shift = sums.par_iter().filter(|s| is_edge(s)).map(|s| f64::from(s.apart)).reduce(|| 0.0, f64::max);
    let weights: Vec<Option<f64>> = sums
        .par_chunks(n)
        .map(|of_pair| {
            let edges = of_pair.iter().filter(|s| is_edge(s));
            edges.map(|s| shift - f64::from(s.apart)).reduce(|a, b| a + b)
        })
        .collect();
    let heaviest = weights.iter().flatten().fold(0.0_f64, |m, &w| m.max(w)).max(f64::MIN_POSITIVE);
    let scaled = |w: f64| 1 + (w / heaviest * (LARGEST_WEIGHT - 1.0)).round() as u32;
    let mut edges: Vec<(u32, u32, u32)> =
        pairs.iter().zip(&weights).filter_map(|(&(a, b), w)| Some((a, b, scaled((*w)?)))).collect();

    let mut has_edge = vec![false; roots.len()];
    edges.iter().for_each(|&(a, b, _)| [a, b].iter().for_each(|&v| has_edge[v as usize] = true));
    let alone: Vec<usize> = (0..roots.len()).filter(|&v| !has_edge[v]).collect();
    let mut ties: Vec<(u32, u32, u32)> = alone
        .par_iter()
        .filter_map(|&v| nearest_other(&roots, v).map(|other| (v.min(other) as u32, v.max(other) as u32, 1)))
        .collect();
    ties.sort_unstable();
    ties.dedup();
    edges.extend(ties);
    Ok(WeightedGraph::from_edges(roots.len(), &edges))
}

/// Median distance (cm) from a root to the nearest other.
fn root_spacing(roots: &[[f32; 3]]) -> f32 {
    // Enough for a median; all of them would be compared with all.
    const LOOKED_AT: usize = 500;
    let step = roots.len().div_ceil(LOOKED_AT).max(1);
    let looked_at: Vec<usize> = (0..roots.len()).step_by(step).collect();
    let mut distances: Vec<f32> = looked_at
        .par_iter()
        .filter_map(|&v| nearest_other(roots, v).map(|other| squared_distance(&roots[v], &roots[other]).sqrt()))
        .collect();
    distances.sort_by(f32::total_cmp);
    distances.get(distances.len() / 2).copied().unwrap_or(0.0).max(LEAST_SPACING_CM)
}

/// Pairs of strands a < b, sorted, of which one is among those most often near to the other on the frames probed.
fn candidate_pairs(frames: &dyn FrameSource, reach: f32, most: usize) -> Result<Vec<(u32, u32)>> {
    let (n_strands, n, n_frames) = (frames.n_strands(), frames.n_particles(), frames.n_frames());
    let mut frame = vec![[0.0_f32; 3]; n_strands * n];
    // Per strand, others and how often one of its particles had them near, sorted by strand.
    let mut counts: Vec<Vec<(u32, u32)>> = vec![Vec::new(); n_strands];
    let probed = PROBED_FRAMES.min(n_frames);
    for probe in 0..probed {
        frames.read((2 * probe + 1) * n_frames / (2 * probed), &mut frame)?;
        let near: Vec<Vec<u32>> = (0..n)
            .map(|i| {
                let layer: Vec<[f32; 3]> = frame.chunks_exact(n).map(|s| s[i]).collect();
                nearest_within(&layer, reach, NOTED)
            })
            .collect();
        counts.par_iter_mut().enumerate().for_each(|(strand, counts)| {
            let of_strand = near.iter().flat_map(|layer| &layer[strand * NOTED..(strand + 1) * NOTED]);
            counts.extend(of_strand.filter(|&&other| other != NOBODY).map(|&other| (other, 1)));
            counts.sort_unstable();
            counts.dedup_by(|now, kept| {
                let same = now.0 == kept.0;
                if same {
                    kept.1 += now.1;
                }
                same
            });
            keep_most(counts, KEPT);
            counts.sort_unstable();
        });
    }
    let mut pairs: Vec<(u32, u32)> = counts
        .par_iter_mut()
        .enumerate()
        .flat_map_iter(|(strand, counts)| {
            keep_most(counts, most);
            counts.iter().map(move |&(other, _)| (other.min(strand as u32), other.max(strand as u32)))
        })
        .collect();
    pairs.par_sort_unstable();
    pairs.dedup();
    Ok(pairs)
}

/// Keeps those counted most, at most so many.
fn keep_most(counts: &mut Vec<(u32, u32)>, most: usize) {
    counts.sort_unstable_by_key(|&(other, count)| (std::cmp::Reverse(count), other));
    counts.truncate(most);
}

/// What is summed for one particle of a pair of strands.
#[derive(Debug, Clone, Copy, Default)]
struct PairSum {
    /// Frames in which the two are near.
    near: u32,
    /// Sum over frames of the squared difference of displacements (cm²).
    apart: f32,
}

/// `pairs.len() * n_particles` sums over all frames.
fn motion_sums(
    frames: &dyn FrameSource,
    rest: &UniformGroom,
    reach: f32,
    pairs: &[(u32, u32)],
    on_frame: &mut dyn FnMut(u64),
) -> Result<Vec<PairSum>> {
    let n = rest.n_particles;
    let mut sums = vec![PairSum::default(); pairs.len() * n];
    let mut frame = vec![[0.0_f32; 3]; rest.points.len()];
    for f in 0..frames.n_frames() {
        frames.read(f, &mut frame)?;
        sums.par_chunks_mut(PAIRS_AT_ONCE * n).zip(pairs.par_chunks(PAIRS_AT_ONCE)).for_each(|(sums, pairs)| {
            for (sums, &(a, b)) in sums.chunks_exact_mut(n).zip(pairs) {
                let (a, b) = (a as usize * n, b as usize * n);
                let now = frame[a..a + n].iter().zip(&frame[b..b + n]);
                let before = rest.points[a..a + n].iter().zip(&rest.points[b..b + n]);
                for ((sum, (pa, pb)), (ra, rb)) in sums.iter_mut().zip(now).zip(before) {
                    let (mut distance, mut apart) = (0.0, 0.0);
                    for c in 0..3 {
                        let d = pa[c] - pb[c];
                        let moved = d - (ra[c] - rb[c]);
                        distance += d * d;
                        apart += moved * moved;
                    }
                    sum.near += u32::from(distance < reach * reach);
                    sum.apart += apart;
                }
            }
        });
        on_frame(f as u64 + 1);
    }
    Ok(sums)
}

/// For each part, the strand that is its guide: from the one with the largest total weight on, swapped for another of the
/// part as long as that adds to the weight between guides and other strands.
///
/// # Panics
/// If a part is empty.
#[must_use]
pub fn guides_of_parts(graph: &WeightedGraph, part: &[u32], n_parts: usize) -> Vec<u32> {
    let mut members = vec![Vec::new(); n_parts];
    part.iter().enumerate().for_each(|(v, &p)| members[p as usize].push(v));
    let total: Vec<i64> = (0..part.len()).map(|v| graph.edges(v).map(|(_, w)| i64::from(w)).sum()).collect();
    let first = |vs: &Vec<usize>| vs.iter().copied().max_by_key(|&v| (total[v], std::cmp::Reverse(v)));
    let mut guides: Vec<usize> =
        members.iter().map(|vs| first(vs).expect("the partitioner leaves no part empty")).collect();
    let mut is_guide = vec![false; part.len()];
    guides.iter().for_each(|&g| is_guide[g] = true);
    loop {
        let mut changed = false;
        for (p, members) in members.iter().enumerate() {
            let now = guides[p];
            // Edges to another guide count for neither; as it loses too, they count twice against a swap.
            let worth = |v: usize| {
                let to_guides = graph.edges(v).filter(|&(e, _)| is_guide[e] && e != now);
                total[v] - 2 * to_guides.map(|(_, w)| i64::from(w)).sum::<i64>()
            };
            let best = members.iter().copied().max_by_key(|&v| (worth(v), v == now, std::cmp::Reverse(v)));
            if let Some(best) = best.filter(|&b| b != now) {
                (is_guide[now], is_guide[best]) = (false, true);
                guides[p] = best;
                changed = true;
            }
        }
        if !changed {
            return guides.iter().map(|&g| g as u32).collect();
        }
    }
}

/// Parts renumbered so that their guides ascend, with the parts each touches.
fn numbered_by_guide(graph: &WeightedGraph, mut part: Vec<u32>, guides: Vec<u32>) -> GuideParts {
    let mut order: Vec<usize> = (0..guides.len()).collect();
    order.sort_unstable_by_key(|&p| guides[p]);
    let mut number = vec![0_u32; guides.len()];
    order.iter().enumerate().for_each(|(new, &old)| number[old] = new as u32);
    part.iter_mut().for_each(|p| *p = number[*p as usize]);
    let between = |v: usize| {
        graph.edges(v).map({
            let part = &part;
            move |(e, w)| (part[v], part[e], u64::from(w))
        })
    };
    let mut links: Vec<(u32, u32, u64)> = (0..part.len()).flat_map(between).filter(|l| l.0 != l.1).collect();
    links.sort_unstable();
    links.dedup_by(|now, kept| {
        let same = (now.0, now.1) == (kept.0, kept.1);
        if same {
            kept.2 += now.2;
        }
        same
    });
    links.sort_unstable_by_key(|&(of, to, weight)| (of, std::cmp::Reverse(weight), to));
    let mut adjacent = vec![Vec::new(); guides.len()];
    links.iter().for_each(|&(of, to, _)| adjacent[of as usize].push(to));
    GuideParts { guide_strands: order.iter().map(|&p| guides[p]).collect(), part, adjacent }
}

#[cfg(test)]
mod tests {
    use io_formats::{FrameInfo, MemoryFrames};
    use rand::seq::SliceRandom;
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    const N: usize = 6;

    /// Strands rooted on a plane; each sways as its group does, with a little noise of its own.
    fn swaying(group_of: &dyn Fn(f32) -> usize, order: &[usize]) -> (UniformGroom, MemoryFrames) {
        const ROWS: usize = 8;
        let n_strands = order.len();
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let own: Vec<f32> = (0..n_strands).map(|_| rng.random_range(0.98..1.02)).collect();
        let jitter: Vec<[f32; 2]> = (0..n_strands).map(|_| [0; 2].map(|_| rng.random_range(-0.2_f32..0.2))).collect();
        let strand = |k: usize, t: f32| -> Vec<[f32; 3]> {
            let root = [(k / ROWS) as f32 + jitter[k][0], (k % ROWS) as f32 + jitter[k][1]];
            // Far enough, against each other, that only roots of different groups stay near.
            let way = if group_of(root[0]).is_multiple_of(2) { 3.0 } else { -3.0 };
            let sway = |i: f32| way * own[k] * i * t.sin();
            (0..N).map(|i| [root[0], root[1] + sway(i as f32), -(i as f32)]).collect()
        };
        let shape = |t: f32| -> Vec<[f32; 3]> { order.iter().flat_map(|&k| strand(k, t)).collect() };
        let rest = UniformGroom { n_strands, n_particles: N, points: shape(0.0) };
        let mut frames = MemoryFrames::new(n_strands, N);
        for f in 0..40 {
            let info = FrameInfo { sequence: 0, time_s: 0.1 * f64::from(f) };
            frames.push(info, &shape(0.3 * f as f32)).expect("the frame has the right number of points");
        }
        (rest, frames)
    }

    fn guides(rest: &UniformGroom, frames: &MemoryFrames, n: usize) -> GuideParts {
        graph_guides(frames, rest, n, &GraphParams::standard(), 1, &mut |_| {}).expect("frames can be read")
    }

    #[test]
    fn two_groups_that_move_alike_within_get_a_guide_each() {
        let order: Vec<usize> = (0..128).collect();
        let group = |x: f32| usize::from(x > 7.5);
        let (rest, frames) = swaying(&group, &order);
        let found = guides(&rest, &frames, 2);
        let of_guide: Vec<usize> = found.guide_strands.iter().map(|&s| group(rest.strand(s as usize)[0][0])).collect();
        assert!(of_guide[0] != of_guide[1], "{found:?}");
        let parted = (0..128).filter(|&s| group(rest.strand(s)[0][0]) != of_guide[found.part[s] as usize]).count();
        assert_eq!(parted, 0, "parts are the groups");
        assert_eq!(found.adjacent, [vec![1], vec![0]]);
    }

    #[test]
    fn the_order_of_strands_does_not_matter() {
        let order: Vec<usize> = (0..128).collect();
        let mut shuffled = order.clone();
        shuffled.shuffle(&mut Pcg64Mcg::seed_from_u64(4));
        let group = |x: f32| usize::from(x > 7.5);
        let names = |order: &[usize]| {
            let (rest, frames) = swaying(&group, order);
            let found = guides(&rest, &frames, 2);
            let mut names: Vec<usize> = found.guide_strands.iter().map(|&s| order[s as usize]).collect();
            names.sort_unstable();
            names
        };
        assert_eq!(names(&order), names(&shuffled));
    }

    #[test]
    fn guides_are_distinct_one_in_each_part_and_as_many_as_asked() {
        let order: Vec<usize> = (0..96).collect();
        let (rest, frames) = swaying(&|x| x as usize / 3, &order);
        for n in [1, 5, 40, 95, 96] {
            let found = guides(&rest, &frames, n);
            assert_eq!(found.guide_strands.len(), n);
            assert!(found.guide_strands.windows(2).all(|w| w[0] < w[1]), "ascending, so distinct");
            let parts: Vec<u32> = found.guide_strands.iter().map(|&s| found.part[s as usize]).collect();
            assert_eq!(parts, (0..n as u32).collect::<Vec<_>>());
        }
    }

    #[test]
    fn no_single_swap_adds_weight_between_guides_and_other_strands() {
        let order: Vec<usize> = (0..96).collect();
        let (rest, frames) = swaying(&|x| x as usize / 3, &order);
        let graph = motion_graph(&frames, &rest, &GraphParams::standard(), &mut |_| {}).expect("frames can be read");
        let part = partition(&graph, 12, 1);
        let guides = guides_of_parts(&graph, &part, 12);
        let worth = |guides: &[u32]| -> u64 {
            let is_guide: Vec<u32> = (0..96).map(|v| u32::from(guides.contains(&v))).collect();
            graph.cut(&is_guide)
        };
        let found = worth(&guides);
        for v in 0..96 {
            let mut swapped = guides.clone();
            swapped[part[v] as usize] = v as u32;
            assert!(worth(&swapped) <= found, "strand {v} would serve better");
        }
    }

    #[test]
    fn strands_far_from_all_others_are_tied_to_the_nearest() {
        let order: Vec<usize> = (0..64).collect();
        let (mut rest, _) = swaying(&|_| 0, &order);
        rest.points[..N].iter_mut().for_each(|p| p[0] -= 50.0);
        let mut frames = MemoryFrames::new(64, N);
        for f in 0..2 {
            let info = FrameInfo { sequence: 0, time_s: f64::from(f) };
            frames.push(info, &rest.points).expect("the frame has the right number of points");
        }
        let graph = motion_graph(&frames, &rest, &GraphParams::standard(), &mut |_| {}).expect("frames can be read");
        assert_eq!(graph.edges(0).count(), 1);
        assert!((1..64).all(|v| graph.edges(v).count() > 0));
    }

    #[test]
    fn the_same_bytes_for_any_number_of_threads() {
        let order: Vec<usize> = (0..96).collect();
        let (rest, frames) = swaying(&|x| x as usize / 3, &order);
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads");
            pool.install(|| {
                let graph = motion_graph(&frames, &rest, &GraphParams::standard(), &mut |_| {});
                (graph.expect("frames can be read"), guides(&rest, &frames, 20))
            })
        };
        let one = with(1);
        for threads in [2, 8] {
            assert!(with(threads) == one, "{threads} threads");
        }
    }
}
