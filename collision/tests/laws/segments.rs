//! Closest points and crossings of moving segments against plain references: dense sampling, and a fine walk through time.

use crate::random::Random;
use collision::segment_pair::{Segment, between, closest_points, first_crossing};
use nalgebra::Vector3;

/// Crossing pairs end up this near, cm; far below a hair's width.
const TOLERANCE: f64 = 1e-6;

/// Agreement asked of two ways to the same distance, cm, for coordinates of a few centimetres.
const ROUND_OFF: f64 = 1e-9;

/// How far inside both segments, as a fraction of them, the plain walk must see a crossing to insist on it: nearer to an
/// end, the walk's own linear interpolation decides, not the motion.
const CLEARLY_INSIDE: f64 = 0.01;

fn point(random: &mut Random, half_size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| f64::from(random.between(-1.0, 1.0)) * half_size)
}

fn segment(random: &mut Random, half_size: f64) -> Segment {
    [point(random, half_size), point(random, half_size)]
}

fn shifted(s: &Segment, random: &mut Random, by: f64) -> Segment {
    let common = point(random, by);
    [s[0] + common + point(random, 0.2 * by), s[1] + common + point(random, 0.2 * by)]
}

/// Least distance over a grid of places, polished by alternating projection.
fn sampled_distance(a: &Segment, b: &Segment) -> f64 {
    let along = |s: &Segment, f: f64| s[0] + (s[1] - s[0]) * f;
    let place = |s: &Segment, x: &Vector3<f64>| {
        let u = s[1] - s[0];
        if u.norm_squared() > 0.0 { ((x - s[0]).dot(&u) / u.norm_squared()).clamp(0.0, 1.0) } else { 0.0 }
    };
    let mut best = f64::INFINITY;
    for k in 0..=20 {
        let mut on_a = along(a, f64::from(k) / 20.0);
        for _ in 0..40 {
            let on_b = along(b, place(b, &on_a));
            on_a = along(a, place(a, &on_b));
            best = best.min((on_b - on_a).norm());
        }
    }
    best
}

#[test]
fn closest_points_are_no_farther_than_any_sampled_ones() {
    let mut random = Random::new(11);
    for case in 0..20_000 {
        let a = segment(&mut random, 1.0);
        let b = match case % 5 {
            0 => segment(&mut random, 1.0),
            // Parallel, nearly parallel, of no length, sharing an end.
            1 => [a[0] + Vector3::new(0.1, 0.2, 0.0), a[1] + Vector3::new(0.1, 0.2, 0.0)],
            2 => [a[0] + point(&mut random, 1e-9), a[1] + point(&mut random, 1e-9)],
            3 => [point(&mut random, 1.0); 2],
            _ => [a[1], point(&mut random, 1.0)],
        };
        let c = closest_points(&a, &b);
        assert!((0.0..=1.0).contains(&c.s) && (0.0..=1.0).contains(&c.t));
        let offset = b[0] + (b[1] - b[0]) * c.t - a[0] - (a[1] - a[0]) * c.s;
        assert!((offset - c.offset).norm() < ROUND_OFF && (offset.norm_squared() - c.distance2).abs() < ROUND_OFF);
        let sampled = sampled_distance(&a, &b);
        assert!(c.distance2.sqrt() < sampled + ROUND_OFF, "case {case}: {} against {sampled}", c.distance2.sqrt());
    }
}

/// Whether a walk of small steps sees the two segments change sides while their lines cross clearly inside both.
fn walk_sees_crossing(a: &[Segment; 2], b: &[Segment; 2], n_steps: u32) -> bool {
    let at = |k: u32| {
        let time = f64::from(k) / f64::from(n_steps);
        (between(&a[0], &a[1], time), between(&b[0], &b[1], time))
    };
    let volume = |(a, b): &(Segment, Segment)| (a[1] - a[0]).cross(&(b[1] - b[0])).dot(&(b[0] - a[0]));
    let inside = |(a, b): &(Segment, Segment)| {
        let (u, v, w) = (a[1] - a[0], b[1] - b[0], b[0] - a[0]);
        let n = u.cross(&v);
        let clear = CLEARLY_INSIDE..=1.0 - CLEARLY_INSIDE;
        let (s, t) = (w.cross(&v).dot(&n) / n.norm_squared(), w.cross(&u).dot(&n) / n.norm_squared());
        clear.contains(&s) && clear.contains(&t)
    };
    let mut before = at(0);
    for k in 1..=n_steps {
        let now = at(k);
        if volume(&before) * volume(&now) < 0.0 && inside(&before) && inside(&now) {
            return true;
        }
        before = now;
    }
    false
}

#[test]
fn no_crossing_of_fast_segments_is_missed() {
    let mut random = Random::new(5);
    let (mut crossed, mut reported) = (0, 0);
    for case in 0..100_000 {
        let scale = if case % 2 == 0 { 1.0 } else { 0.05 };
        let (a, b) = (segment(&mut random, scale), segment(&mut random, scale));
        // Up to four times their size in one step, as hair of a centimetre a segment at 10 m/s over some milliseconds.
        let (a, b) = ([a, shifted(&a, &mut random, 2.0 * scale)], [b, shifted(&b, &mut random, 2.0 * scale)]);
        let hit = first_crossing(&a[0], &a[1], &b[0], &b[1], TOLERANCE);
        if walk_sees_crossing(&a, &b, 400) {
            crossed += 1;
            assert!(hit.is_some(), "case {case} crosses unseen");
        }
        if let Some(hit) = hit {
            reported += 1;
            let (a, b) = (between(&a[0], &a[1], hit.time), between(&b[0], &b[1], hit.time));
            assert!((0.0..=1.0).contains(&hit.time));
            let apart = b[0] + (b[1] - b[0]) * hit.t - a[0] - (a[1] - a[0]) * hit.s;
            assert!(apart.norm() <= TOLERANCE, "case {case} is reported from {} cm", apart.norm());
        }
    }
    assert!(crossed > 5_000, "only {crossed} cases cross: the law was hardly tried");
    // Crossings near an end and double crossings within one small step are all that the walk may leave out.
    assert!(reported < crossed + crossed / 4, "{reported} reported, {crossed} seen by the walk");
}

#[test]
fn a_reported_hit_is_the_first() {
    let a = [Vector3::new(-1.0, 0.0, 0.0), Vector3::new(1.0, 0.0, 0.0)];
    let b = [Vector3::new(0.2, -1.0, 1.0), Vector3::new(0.2, 1.0, 1.0)];
    let end = [b[0] - Vector3::z() * 4.0, b[1] - Vector3::z() * 4.0];
    let hit = first_crossing(&a, &a, &b, &end, TOLERANCE).expect("falls through");
    assert!((hit.time - 0.25).abs() < TOLERANCE && (hit.s - 0.6).abs() < TOLERANCE && (hit.t - 0.5).abs() < TOLERANCE);
}

#[test]
fn motion_in_one_plane_is_tested_all_the_same() {
    // The volume is zero throughout: only distances can tell.
    let mut random = Random::new(8);
    let flat = |p: Vector3<f64>| Vector3::new(p.x, p.y, 0.0);
    let mut met = 0;
    for case in 0..20_000 {
        let (a, b) = (segment(&mut random, 1.0).map(flat), segment(&mut random, 1.0).map(flat));
        let (a, b) = ([a, shifted(&a, &mut random, 1.0).map(flat)], [b, shifted(&b, &mut random, 1.0).map(flat)]);
        let meets = (0..=200).any(|k| {
            let time = f64::from(k) / 200.0;
            let (a, b) = (between(&a[0], &a[1], time), between(&b[0], &b[1], time));
            let side = |s: &Segment, p: &Vector3<f64>| (s[1] - s[0]).cross(&(p - s[0])).z;
            side(&a, &b[0]) * side(&a, &b[1]) < 0.0 && side(&b, &a[0]) * side(&b, &a[1]) < 0.0
        });
        if meets {
            met += 1;
            assert!(first_crossing(&a[0], &a[1], &b[0], &b[1], TOLERANCE).is_some(), "case {case}");
        }
    }
    assert!(met > 2_000, "only {met} cases meet");
}

#[test]
fn parallel_segments_meet_and_part() {
    let a = [Vector3::zeros(), Vector3::x()];
    let above = [Vector3::new(0.3, 0.0, 0.5), Vector3::new(1.3, 0.0, 0.5)];
    let below = [above[0] - Vector3::z(), above[1] - Vector3::z()];
    let higher = [above[0] + Vector3::z(), above[1] + Vector3::z()];
    let hit = first_crossing(&a, &a, &above, &below, TOLERANCE).expect("one falls through the other");
    assert!((hit.time - 0.5).abs() < TOLERANCE);
    assert!(first_crossing(&a, &a, &above, &higher, TOLERANCE).is_none());
    // Sliding past each other a tenth of a millimetre apart is no crossing.
    let beside = [Vector3::new(-3.0, 0.0, 0.01), Vector3::new(-2.0, 0.0, 0.01)];
    let past = [Vector3::new(3.0, 0.0, 0.01), Vector3::new(4.0, 0.0, 0.01)];
    assert!(first_crossing(&a, &a, &beside, &past, TOLERANCE).is_none());
}

#[test]
fn points_still_segments_and_broken_numbers_are_answered() {
    let p = [Vector3::zeros(); 2];
    let q = [Vector3::new(1.0, 0.0, 0.0); 2];
    let past = [Vector3::new(-1.0, 0.0, 0.0); 2];
    assert!(first_crossing(&p, &p, &q, &past, TOLERANCE).is_some(), "two points meet");
    assert!(first_crossing(&p, &p, &q, &q, TOLERANCE).is_none(), "nothing moves");
    let broken = [Vector3::new(f64::NAN, 0.0, 0.0), Vector3::x()];
    assert!(first_crossing(&p, &p, &broken, &q, TOLERANCE).is_none());
    assert!(first_crossing(&p, &p, &q, &broken, TOLERANCE).is_none());
}
