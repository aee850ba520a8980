//! The hashed grid against all pairs tried one by one: the same pairs, whatever the sizes and the thread count.

use crate::random::Random;
use collision::spatial_hash::{PairList, SegmentBox, SegmentGrid};
use nalgebra::Vector3;

fn vector(random: &mut Random, half_size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| f64::from(random.between(-1.0, 1.0)) * half_size)
}

/// Boxes around segments of the given lengths, in a cube.
fn boxes(seed: u64, n: usize, half_size: f64, length: impl Fn(usize) -> f64) -> Vec<SegmentBox> {
    let mut random = Random::new(seed);
    (0..n)
        .map(|i| {
            let a = vector(&mut random, half_size);
            SegmentBox::around(&[a, a + vector(&mut random, length(i))], 0.05)
        })
        .collect()
}

fn found(grid: &mut SegmentGrid, boxes: &[SegmentBox], active: &(impl Fn(usize) -> bool + Sync)) -> Vec<(u32, u32)> {
    let mut list = PairList::default();
    grid.rebuild(boxes.len(), |i| boxes[i]);
    grid.collect_active(&mut list, active, |_, _| Some(()));
    list.pairs().iter().map(|p| (p.i, p.j)).collect()
}

fn check(grid: &mut SegmentGrid, boxes: &[SegmentBox]) -> usize {
    let every_third = |i: usize| i.is_multiple_of(3);
    let mut all = Vec::new();
    for j in 0..boxes.len() {
        for i in 0..j {
            if boxes[i].overlaps(&boxes[j]) {
                all.push((i as u32, j as u32));
            }
        }
    }
    all.sort_unstable();
    assert_eq!(found(grid, boxes, &|_| true), all);
    let some: Vec<_> =
        all.iter().copied().filter(|&(i, j)| every_third(i as usize) || every_third(j as usize)).collect();
    assert_eq!(found(grid, boxes, &every_third), some);
    all.len()
}

#[test]
fn the_grid_finds_exactly_the_overlapping_pairs() {
    // One grid for all: what a larger or smaller scene left behind must not matter.
    let mut grid = SegmentGrid::default();
    let mut n_pairs = 0;
    for (seed, n, half_size) in
        [(1, 3_000, 3.0), (2, 700, 0.4), (3, 2_000, 1e4), (4, 1, 1.0), (5, 0, 1.0), (6, 2, 0.01)]
    {
        n_pairs += check(&mut grid, &boxes(seed, n, half_size, |_| 0.5));
    }
    assert!(n_pairs > 50_000, "only {n_pairs} pairs: the law was hardly tried");
}

#[test]
fn sizes_may_differ_a_thousandfold() {
    let mut grid = SegmentGrid::default();
    let n_pairs = check(&mut grid, &boxes(7, 2_000, 3.0, |i| 0.01 * 2f64.powi((i % 11) as i32)));
    assert!(n_pairs > 10_000);
    // A few very long ones among many short ones: a strand thrown far in one step.
    check(&mut grid, &boxes(8, 2_000, 3.0, |i| if i % 500 == 0 { 300.0 } else { 0.1 }));
}

#[test]
fn coincident_far_and_broken_boxes_are_answered() {
    let mut grid = SegmentGrid::default();
    let same = vec![SegmentBox::around(&[Vector3::new(1.0, 2.0, 3.0)], 0.0); 200];
    assert_eq!(check(&mut grid, &same), 200 * 199 / 2);
    let mut far = boxes(9, 500, 1.0, |_| 0.3);
    far[3] = SegmentBox::around(&[Vector3::repeat(1e30), Vector3::repeat(1.1e30)], 0.0);
    far[4] = SegmentBox::around(&[Vector3::repeat(1.05e30)], 0.0);
    far[5] = SegmentBox::around(&[Vector3::new(0.0, f64::NAN, 0.0)], 1.0);
    far[6] = SegmentBox::around(&[Vector3::new(f64::INFINITY, 0.0, 0.0)], 1.0);
    far[7] = SegmentBox::around(&[Vector3::repeat(1e300)], 1.0);
    check(&mut grid, &far);
    let pairs = found(&mut grid, &far, &|_| true);
    assert!(pairs.contains(&(3, 4)) && !pairs.iter().any(|&(i, j)| [5, 6, 7].contains(&i) || [5, 6, 7].contains(&j)));
}

#[test]
fn a_box_contains_its_points_after_rounding() {
    let mut random = Random::new(10);
    for _ in 0..1_000 {
        let p = vector(&mut random, 50.0) / 3.0;
        let exact = SegmentBox::around(&[p], 0.0);
        // A point one rounding step away on each side is still within reach of the box.
        assert!(exact.overlaps(&SegmentBox::around(&[p.map(|c| c.next_up())], 0.0)));
        assert!(exact.overlaps(&SegmentBox::around(&[p.map(|c| c.next_down())], 0.0)));
    }
}

#[test]
fn pairs_do_not_depend_on_the_thread_count() {
    let boxes = boxes(12, 20_000, 5.0, |i| if i % 100 == 0 { 4.0 } else { 0.4 });
    let with = |n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("threads");
        pool.install(|| found(&mut SegmentGrid::default(), &boxes, &|_| true))
    };
    let one = with(1);
    assert!(one.len() > 20_000);
    assert!(with(2) == one && with(8) == one);
}
