//! The hashed grid against all pairs tried one by one: the same pairs, whatever the sizes and the thread count.

use crate::random::Random;
use collision::segment_pair::{Sweep, closest_points, first_crossing};
use collision::spatial_hash::{PairList, SegmentGrid};
use nalgebra::Vector3;

/// Distance within which still segments are asked for, cm.
const REACH: f64 = 0.1;

/// Distance that counts as touching where segments move, cm.
const TOUCHING: f64 = 1e-6;

fn vector(random: &mut Random, half_size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| f64::from(random.between(-1.0, 1.0)) * half_size)
}

/// Still segments of the given lengths, in a cube.
fn segments(seed: u64, n: usize, half_size: f64, length: impl Fn(usize) -> f64) -> Vec<Sweep> {
    let mut random = Random::new(seed);
    (0..n)
        .map(|i| {
            let a = vector(&mut random, half_size);
            Sweep::still([a, a + vector(&mut random, length(i))])
        })
        .collect()
}

/// Combed hair: strands side by side that move alike, but for a little.
fn combed(seed: u64, n: usize, own_motion: f64) -> Vec<Sweep> {
    let mut random = Random::new(seed);
    (0..n)
        .map(|_| {
            let a = vector(&mut random, 1.5);
            let b = a + Vector3::new(0.1, -0.8, 0.05) + vector(&mut random, 0.1);
            let common = Vector3::new(0.6, 0.1 * a.y, -0.3);
            let [c, d] = [a, b].map(|p| p + common + vector(&mut random, own_motion));
            Sweep { start: [a, b], end: [c, d] }
        })
        .collect()
}

/// Whether a pair is one the caller wants: within reach if still, crossing if not.
fn meets(a: &Sweep, b: &Sweep) -> bool {
    if a.start == a.end && b.start == b.end {
        closest_points(&a.start, &b.start).distance2 < REACH * REACH
    } else {
        first_crossing(&a.start, &a.end, &b.start, &b.end, TOUCHING).is_some()
    }
}

fn reach_of(sweeps: &[Sweep]) -> f64 {
    if sweeps.iter().all(|s| s.start == s.end) { REACH } else { TOUCHING }
}

fn found(grid: &mut SegmentGrid, sweeps: &[Sweep], active: &(impl Fn(usize) -> bool + Sync)) -> Vec<(u32, u32)> {
    let mut list = PairList::default();
    grid.rebuild(sweeps.len(), reach_of(sweeps), |i| sweeps[i]);
    grid.collect_active(&mut list, active, |i, j| meets(&sweeps[i], &sweeps[j]).then_some(()));
    list.pairs().iter().map(|p| (p.i, p.j)).collect()
}

fn check(grid: &mut SegmentGrid, sweeps: &[Sweep]) -> usize {
    let every_third = |i: usize| i.is_multiple_of(3);
    let mut all = Vec::new();
    for j in 0..sweeps.len() {
        for i in 0..j {
            if meets(&sweeps[i], &sweeps[j]) {
                all.push((i as u32, j as u32));
            }
        }
    }
    all.sort_unstable();
    assert_eq!(found(grid, sweeps, &|_| true), all);
    let some: Vec<_> =
        all.iter().copied().filter(|&(i, j)| every_third(i as usize) || every_third(j as usize)).collect();
    assert_eq!(found(grid, sweeps, &every_third), some);
    // The search that looks at each pair from one side only.
    let mut list = PairList::default();
    grid.rebuild(sweeps.len(), reach_of(sweeps), |i| sweeps[i]);
    grid.collect(&mut list, |i, j| meets(&sweeps[i], &sweeps[j]).then_some(()));
    assert_eq!(list.pairs().iter().map(|p| (p.i, p.j)).collect::<Vec<_>>(), all);
    all.len()
}

#[test]
fn the_grid_misses_no_pair_within_reach() {
    // One grid for all: what a larger or smaller scene left behind must not matter.
    let mut grid = SegmentGrid::default();
    let mut n_pairs = 0;
    for (seed, n, half_size) in
        [(1, 3_000, 1.0), (2, 700, 0.4), (3, 2_000, 1e4), (4, 1, 1.0), (5, 0, 1.0), (6, 2, 0.01)]
    {
        n_pairs += check(&mut grid, &segments(seed, n, half_size, |_| 0.5));
    }
    assert!(n_pairs > 40_000, "only {n_pairs} pairs: the law was hardly tried");
}

#[test]
fn no_crossing_of_combed_hair_is_missed() {
    let mut grid = SegmentGrid::default();
    let mut n_pairs = 0;
    for (seed, own_motion) in [(21, 0.3), (22, 0.05), (23, 0.01)] {
        n_pairs += check(&mut grid, &combed(seed, 2_000, own_motion));
    }
    assert!(n_pairs > 2_000, "only {n_pairs} crossings: the law was hardly tried");
}

#[test]
fn of_hair_that_moves_together_hardly_any_pair_is_looked_at() {
    const N: usize = 2_000;
    let sweeps = combed(24, N, 0.01);
    let (mut grid, mut list) = (SegmentGrid::default(), PairList::default());
    grid.rebuild(N, TOUCHING, |i| sweeps[i]);
    grid.collect(&mut list, |_, _| Some(()));
    let boxes_overlap = |a: &Sweep, b: &Sweep| {
        let bounds = |s: &Sweep| {
            let points = [s.start[0], s.start[1], s.end[0], s.end[1]];
            (points.iter().fold(points[0], |m, p| m.inf(p)), points.iter().fold(points[0], |m, p| m.sup(p)))
        };
        let ((a_low, a_high), (b_low, b_high)) = (bounds(a), bounds(b));
        (0..3).all(|c| a_low[c] <= b_high[c] && b_low[c] <= a_high[c])
    };
    let n_boxes: usize = (0..N).map(|j| (0..j).filter(|&i| boxes_overlap(&sweeps[i], &sweeps[j])).count()).sum();
    let n_pairs = list.pairs().len();
    assert!(20 * n_pairs < n_boxes, "{n_pairs} of {n_boxes} pairs of boxes: a twentieth was expected at most");
}

#[test]
fn a_pair_is_found_within_the_shorter_reach_of_its_two() {
    let sweeps = segments(25, 2_000, 1.0, |_| 0.5);
    let reach = |i: usize| if i.is_multiple_of(4) { REACH } else { 0.2 * REACH };
    let near = |i: usize, j: usize| {
        closest_points(&sweeps[i].start, &sweeps[j].start).distance2 < reach(i).min(reach(j)).powi(2)
    };
    let mut all: Vec<(u32, u32)> = Vec::new();
    for i in 0..sweeps.len() {
        all.extend((i + 1..sweeps.len()).filter(|&j| near(i, j)).map(|j| (i as u32, j as u32)));
    }
    let (mut grid, mut list) = (SegmentGrid::default(), PairList::default());
    grid.rebuild(sweeps.len(), REACH, |i| sweeps[i]);
    grid.collect_within(&mut list, reach, |i, j| near(i, j).then_some(()));
    assert!(all.len() > 1_000);
    assert_eq!(list.pairs().iter().map(|p| (p.i, p.j)).collect::<Vec<_>>(), all);
}

#[test]
fn sizes_may_differ_a_thousandfold() {
    let mut grid = SegmentGrid::default();
    let n_pairs = check(&mut grid, &segments(7, 2_000, 1.0, |i| 0.01 * 2f64.powi((i % 11) as i32)));
    assert!(n_pairs > 10_000);
    // A few very long ones among many short ones: a strand thrown far in one step.
    check(&mut grid, &segments(8, 2_000, 3.0, |i| if i % 500 == 0 { 300.0 } else { 0.1 }));
}

#[test]
fn coincident_far_and_broken_segments_are_answered() {
    let point = |x: f64| Sweep::still([Vector3::repeat(x); 2]);
    let mut grid = SegmentGrid::default();
    assert_eq!(check(&mut grid, &vec![point(1.0); 200]), 200 * 199 / 2);
    let mut far = segments(9, 500, 1.0, |_| 0.3);
    far[3] = Sweep::still([Vector3::repeat(1e30), Vector3::repeat(1.1e30)]);
    far[4] = point(1e30);
    far[5] = Sweep::still([Vector3::new(0.0, f64::NAN, 0.0), Vector3::zeros()]);
    far[6] = Sweep::still([Vector3::zeros(), Vector3::new(f64::INFINITY, 0.0, 0.0)]);
    far[7] = Sweep { start: [Vector3::zeros(); 2], end: [Vector3::zeros(), Vector3::repeat(f64::NAN)] };
    let pairs = found(&mut grid, &far, &|_| true);
    assert!(pairs.contains(&(3, 4)) && !pairs.iter().any(|&(i, j)| [5, 6, 7].contains(&i) || [5, 6, 7].contains(&j)));
}

#[test]
fn pairs_do_not_depend_on_the_thread_count() {
    let sweeps = segments(12, 20_000, 3.5, |i| if i % 100 == 0 { 4.0 } else { 0.4 });
    let with = |n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("threads");
        pool.install(|| found(&mut SegmentGrid::default(), &sweeps, &|_| true))
    };
    let one = with(1);
    assert!(one.len() > 20_000);
    assert!(with(2) == one && with(8) == one);
}
