//! Ways to look good without being good, each with the measure that tells: no one measure is enough, which is why reports show
//! them beside each other.
//!
//! One strand of 24 cm hangs along -y from the origin; a rod of 1 mm lies across its way, 10.37 cm down. What each measure must
//! say follows from where strand and rod are.

use super::*;
use crate::run::ErrorSum;
use collision::SolidPose;

/// Particles of the strand, 1 cm apart.
const N: usize = 25;
/// Radius of the rod, cm.
const ROD_CM: f32 = 0.1;
/// How far a distance read from the rod's grid is off at most, cm.
const GRID_CM: f64 = 0.02;
/// Products and differences of positions around 25 cm in f32.
const ROUND_OFF: f64 = 1e-5;
/// Bins of the histogram that percentiles come from: neighbours differ by less than this share.
const BIN: f64 = 0.05;

fn strand(x: f32) -> Vec<[f32; 3]> {
    (0..N).map(|i| [x, -(i as f32), 0.0]).collect()
}

/// The rod's axis along z, at `x` and 10.37 cm down.
fn rod_at(x: f64) -> Isometry3<f64> {
    Isometry3::translation(x, -10.37, 0.0) * Isometry3::rotation(Vector3::x() * std::f64::consts::FRAC_PI_2)
}

/// A strand through these states beside a rod at these places, one a step.
fn observed(states: &[Vec<[f32; 3]>], rod: impl Fn(usize) -> f64) -> Measured {
    let solid = crate::shapes::rod(ROD_CM, 4.0).expect("a valid rod");
    let reach = vec![vec![0]; states.len()];
    let rest = strand(0.0);
    let mut observer = Observer::new(&rest, N, &reach);
    for (step, state) in states.iter().enumerate() {
        let pose = SolidPose { from: rod_at(rod(step.saturating_sub(1))), to: rod_at(rod(step)) };
        observer.observe(state, &[MovingSolid { solid: &solid, pose }], None);
    }
    observer.finish()
}

/// Whether the strand was neither inside nor crossed.
fn is_clean(m: &Measured) -> bool {
    m.near_strands_inside_pct == 0.0 && m.passed_through_pct == 0.0
}

#[test]
fn hair_held_off_is_clean_and_its_standoff_tells() {
    let touching = observed(&vec![strand(-0.13); 3], |_| 0.0);
    let padded = observed(&vec![strand(-0.6); 3], |_| 0.0);
    assert!(is_clean(&touching) && is_clean(&padded), "who only looks for hair inside cannot tell them apart");
    assert!((touching.mean_standoff_cm - 0.03).abs() < GRID_CM, "{}", touching.mean_standoff_cm);
    assert!((padded.mean_standoff_cm - 0.5).abs() < GRID_CM, "{}", padded.mean_standoff_cm);
}

#[test]
fn frozen_hair_does_not_flicker_and_its_error_tells() {
    const SWING_CM: f64 = 2.0;
    const TURN: f64 = 0.1;
    let swinging: Vec<_> = (0..200).map(|k| strand((SWING_CM * (TURN * f64::from(k)).sin()) as f32)).collect();
    let far = |_| 50.0;
    let (moving, frozen) = (observed(&swinging, far), observed(&vec![strand(0.0); 200], far));
    // A second difference of A sin(k a) is at most A (2 - 2 cos a).
    let most = SWING_CM * (2.0 - 2.0 * TURN.cos());
    assert!((moving.flicker_all_p999_cm / most - 1.0).abs() < BIN, "{} of {most}", moving.flicker_all_p999_cm);
    assert_eq!((frozen.flicker_all_median_cm, frozen.flicker_all_p999_cm), (0.0, 0.0));

    let rest = strand(0.0);
    let mut error = ErrorSum::new(&rest, N, &[0]);
    swinging.iter().for_each(|state| error.add(&rest, state, &Isometry3::identity()));
    // The mean square of a sine is a half; the strand is 24 cm long.
    let off = 100.0 * SWING_CM / 2f64.sqrt() / 24.0;
    let found = error.finish();
    assert!((found.near / off - 1.0).abs() < BIN, "{} of {off}", found.near);
    assert_eq!(found.near, found.rigid, "frozen hair is as wrong as hair that only turns with its head");
}

#[test]
fn shaking_hair_is_told_from_moving_hair() {
    // Two steps forward, one back: the same way in the end.
    let even: Vec<_> = (0..60).map(|k| strand(0.1 * k as f32)).collect();
    let shaking: Vec<_> = (0..60).map(|k| strand(0.1 * k as f32 + if k % 2 == 0 { 0.05 } else { -0.05 })).collect();
    let far = |_| 50.0;
    assert!(observed(&even, far).flicker_all_p999_cm < ROUND_OFF);
    let flicker = observed(&shaking, far).flicker_near_median_cm;
    assert!((flicker / 0.2 - 1.0).abs() < BIN, "{flicker}");
}

#[test]
fn hair_through_a_rod_has_passed_however_fast_and_whoever_moves() {
    for steps in [1, 3, 40] {
        let at = |k: usize| 0.5 - k as f32 / steps as f32;
        let hair: Vec<_> = (0..=steps).map(|k| strand(at(k))).collect();
        assert_eq!(observed(&hair, |_| 0.0).passed_through_pct, 100.0, "hair in {steps} steps");
        let still = vec![strand(0.0); steps + 1];
        let rod = observed(&still, |k| f64::from(at(k)));
        assert_eq!(rod.passed_through_pct, 100.0, "a rod in {steps} steps");
    }
    // In one step it is inside at no step's end.
    assert_eq!(observed(&[strand(0.5), strand(-0.5)], |_| 0.0).near_strands_inside_pct, 0.0);
    // Past its end, both being where they were seen before: no way through.
    let past: Vec<_> = [0.5, -0.5].map(|x| strand(x).iter().map(|p| [p[0], p[1], 3.0]).collect()).to_vec();
    assert!(is_clean(&observed(&past, |_| 0.0)));
    // Along with it.
    let along: Vec<_> = [0.0, 0.5, 1.0].map(|x| strand(x as f32 - 0.2)).to_vec();
    assert!(is_clean(&observed(&along, |k| 0.5 * k as f64)));
}

#[test]
fn hair_made_longer_or_shorter_is_told_by_its_stretch() {
    for (scale, stretch) in [(1.1, 0.1), (0.9, 0.1), (1.0, 0.0)] {
        let state: Vec<_> = strand(-0.6).iter().map(|p| [p[0], scale * p[1], p[2]]).collect();
        let m = observed(&vec![state; 2], |_| 0.0);
        assert!(is_clean(&m));
        for found in [m.mean_stretch, m.max_stretch] {
            assert!((found - stretch).abs() < ROUND_OFF, "{found} of {stretch}");
        }
        assert!((m.p99_stretch - stretch).abs() <= BIN * stretch + ROUND_OFF, "{}", m.p99_stretch);
    }
    // Pulled out of one segment alone, as where a comb tugs: the mean hides it, the largest does not.
    let mut tugged = strand(-0.6);
    tugged.iter_mut().skip(20).for_each(|p| p[1] -= 0.5);
    let m = observed(&[tugged], |_| 0.0);
    assert!((m.max_stretch - 0.5).abs() < ROUND_OFF && (m.mean_stretch - 0.5 / 24.0).abs() < ROUND_OFF);
}

#[test]
fn hair_hidden_in_the_head_is_told_apart() {
    let head = crate::shapes::sphere(9.0).expect("a valid ball");
    // Roots on the ball: one strand hangs outside, one is pulled straight in, hidden from every picture.
    let outside: Vec<[f32; 3]> = (0..N).map(|i| [9.0 + 0.3 * i as f32, 0.0, 0.0]).collect();
    let inside: Vec<[f32; 3]> = (0..N).map(|i| [-9.0 + 0.3 * i as f32, 0.0, 0.0]).collect();
    let rest = [outside.clone(), outside.iter().map(|p| [-p[0], p[1], p[2]]).collect()].concat();
    let state = [outside, inside].concat();
    let reach = Reach::new();
    let mut observer = Observer::new(&rest, N, &reach);
    let moving = MovingSolid { solid: &head, pose: SolidPose::still(Isometry3::identity()) };
    observer.observe(&state, &[], Some(&moving));
    let m = observer.finish();
    assert_eq!(m.inside_head_pct, 50.0);
    assert!(is_clean(&m) && m.max_stretch < ROUND_OFF, "nothing else tells");
}

#[test]
fn hair_that_is_nowhere_is_not_clean() {
    let mut gone = strand(-0.6);
    gone.iter_mut().skip(3).for_each(|p| *p = [f32::NAN; 3]);
    let m = observed(&vec![gone; 2], |_| 0.0);
    assert_eq!(m.nonfinite, 2 * 3 * (N as u64 - 3));
    // Sent away altogether, it stands off farther than hair is long.
    let away = observed(&vec![strand(-300.0); 2], |_| 0.0);
    assert!(is_clean(&away) && away.mean_standoff_cm > 24.0);
    // Shrunk to its root it has no length.
    assert!((observed(&vec![vec![[-0.6, 0.0, 0.0]; N]; 2], |_| 0.0).mean_stretch - 1.0).abs() < ROUND_OFF);
}
