//! Which points of a set lie near each other: a grid of cells as wide as the reach, kept as a sorted list.
//!
//! Lists are a function of the points alone: ties go to the lower index, threads only share out the queries.

use rayon::prelude::*;

/// Stands for no neighbour.
pub(crate) const NOBODY: u32 = u32::MAX;
/// Cells a coordinate can number; farther points share the last.
const CELLS: i64 = 1 << 20;

/// For each point the nearest others within `reach` (cm), at most `most`, the nearest first, filled up with [`NOBODY`]:
/// `points.len() * most` indices.
pub(crate) fn nearest_within(points: &[[f32; 3]], reach: f32, most: usize) -> Vec<u32> {
    let cell = |x: f32| (f64::from(x / reach).floor() as i64).clamp(-CELLS + 2, CELLS - 2) + CELLS;
    let key = |c: [i64; 3]| ((c[0] as u64) << 42) | ((c[1] as u64) << 21) | c[2] as u64;
    let mut sorted: Vec<(u64, u32)> =
        points.par_iter().enumerate().map(|(at, p)| (key(p.map(cell)), at as u32)).collect();
    sorted.par_sort_unstable();
    let mut out = vec![NOBODY; points.len() * most];
    out.par_chunks_mut(most.max(1)).zip(points).enumerate().for_each_init(Vec::new, |found, (at, (out, p))| {
        found.clear();
        let c = p.map(cell);
        for x in c[0] - 1..=c[0] + 1 {
            for y in c[1] - 1..=c[1] + 1 {
                // Three cells along z lie side by side in the list.
                let (first, last) = (key([x, y, c[2] - 1]), key([x, y, c[2] + 1]));
                let from = sorted.partition_point(|e| e.0 < first);
                for &(_, other) in sorted[from..].iter().take_while(|e| e.0 <= last) {
                    let squared = squared_distance(p, &points[other as usize]);
                    if squared < reach * reach && other as usize != at {
                        found.push((squared, other));
                    }
                }
            }
        }
        let order = |a: &(f32, u32), b: &(f32, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        if found.len() > most {
            found.select_nth_unstable_by(most, order);
            found.truncate(most);
        }
        found.sort_unstable_by(order);
        out.iter_mut().zip(found.iter()).for_each(|(o, f)| *o = f.1);
    });
    out
}

/// Index of the point nearest to point `at` that is another one; the lowest of equally near ones.
pub(crate) fn nearest_other(points: &[[f32; 3]], at: usize) -> Option<usize> {
    let others = (0..points.len()).filter(|&other| other != at);
    others.min_by(|&a, &b| {
        squared_distance(&points[at], &points[a]).total_cmp(&squared_distance(&points[at], &points[b]))
    })
}

pub(crate) fn squared_distance(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    (0..3).map(|c| (a[c] - b[c]) * (a[c] - b[c])).sum()
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn the_grid_finds_what_a_search_of_all_pairs_finds() {
        let mut rng = Pcg64Mcg::seed_from_u64(8);
        let mut points: Vec<[f32; 3]> = (0..400).map(|_| [0; 3].map(|_| rng.random_range(-3.0_f32..3.0))).collect();
        points[7] = points[6];
        for (reach, most) in [(0.3, 4), (1.0, 8), (20.0, 5), (20.0, 400)] {
            let found = nearest_within(&points, reach, most);
            for (at, found) in found.chunks_exact(most).enumerate() {
                let mut all: Vec<(f32, u32)> = (0..points.len())
                    .filter(|&other| other != at)
                    .map(|other| (squared_distance(&points[at], &points[other]), other as u32))
                    .filter(|d| d.0 < reach * reach)
                    .collect();
                all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                let mut expected: Vec<u32> = all.iter().take(most).map(|d| d.1).collect();
                expected.resize(most, NOBODY);
                assert_eq!(found, expected);
            }
        }
    }
}
