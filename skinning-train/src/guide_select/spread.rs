//! Guides chosen without looking at motion, as baselines: drawn at random, or spread evenly over the scalp.

use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::near::squared_distance;

/// `n` distinct strands of `n_strands`, ascending, every choice as likely as any other.
///
/// # Panics
/// If there are fewer strands.
#[must_use]
pub fn random_guides(n_strands: usize, n: usize, seed: u64) -> Vec<u32> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut guides: Vec<u32> = rand::seq::index::sample(&mut rng, n_strands, n).into_iter().map(|s| s as u32).collect();
    guides.sort_unstable();
    guides
}

/// `n` distinct strands, ascending, each chosen as the one rooted farthest from those before it; the first is the one
/// nearest to the middle of all roots. Of equally far ones the first.
///
/// # Panics
/// If there are fewer strands than asked for.
#[must_use]
pub fn uniform_guides(roots: &[[f32; 3]], n: usize) -> Vec<u32> {
    assert!(n <= roots.len(), "{n} guides of {} strands", roots.len());
    let middle = [0, 1, 2].map(|c| (roots.iter().map(|r| f64::from(r[c])).sum::<f64>() / roots.len() as f64) as f32);
    let to_middle = |s: &usize| squared_distance(&roots[*s], &middle);
    let mut next = (0..roots.len()).min_by(|a, b| to_middle(a).total_cmp(&to_middle(b)));
    // Squared distance (cm²) to the nearest guide so far; below zero for guides themselves, which roots may share.
    let mut distance = vec![f32::INFINITY; roots.len()];
    let mut guides = Vec::with_capacity(n);
    while guides.len() < n {
        let Some(guide) = next else { break };
        guides.push(guide as u32);
        distance.par_iter_mut().zip(roots).for_each(|(d, root)| *d = d.min(squared_distance(root, &roots[guide])));
        distance[guide] = -1.0;
        next = (0..roots.len()).max_by(|&a, &b| distance[a].total_cmp(&distance[b]).then(b.cmp(&a)));
    }
    guides.sort_unstable();
    guides
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;

    fn square(n: usize) -> Vec<[f32; 3]> {
        let mut rng = Pcg64Mcg::seed_from_u64(6);
        (0..n).map(|_| [rng.random(), rng.random(), 0.0]).collect()
    }

    #[test]
    fn baselines_give_exactly_so_many_distinct_guides() {
        let mut roots = square(50);
        roots[20] = roots[10];
        for n in [1, 7, 49, 50] {
            for guides in [random_guides(50, n, 3), uniform_guides(&roots, n)] {
                assert_eq!(guides.len(), n);
                assert!(guides.windows(2).all(|w| w[0] < w[1]) && guides[n - 1] < 50);
            }
        }
        assert!(random_guides(50, 7, 3) != random_guides(50, 7, 4), "the seed decides");
    }

    #[test]
    fn guides_spread_evenly_keep_apart_as_far_as_every_strand_is_near_one() {
        let roots = square(2000);
        let guides = uniform_guides(&roots, 60);
        let nearest = |s: usize, but: Option<u32>| {
            let others = guides.iter().filter(|&&g| Some(g) != but);
            others.map(|&g| squared_distance(&roots[s], &roots[g as usize])).fold(f32::INFINITY, f32::min)
        };
        let apart = guides.iter().map(|&g| nearest(g as usize, Some(g))).fold(f32::INFINITY, f32::min);
        let covered = (0..2000).map(|s| nearest(s, None)).fold(0.0, f32::max);
        // What makes it a packing and a covering with one radius: the farthest strand was no farther than the last guide.
        assert!(covered <= apart, "{covered} {apart}");
    }
}
