//! More strands from few: the groom's own stay, new ones keep its shape.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test code")]

mod common;

use common::shared_data;
use io_formats::densify::densify;
use io_formats::groom::{UniformGroom, arc_length};
use io_formats::{Error, LengthUnit, read_groom};
use nalgebra::Vector3;

/// Single precision of coordinates up to some tens of centimetres.
const ROUND_OFF_CM: f32 = 1e-4;

/// A lock of `n * n` strands on a square, each of 20 points made by `point` from its root and a place from 0 to 1.
fn lock(n: usize, point: impl Fn([f32; 2], f32) -> [f32; 3]) -> UniformGroom {
    let points = (0..n * n)
        .flat_map(|k| {
            let root = [(k % n) as f32, (k / n) as f32];
            (0..20).map(move |i| (root, i as f32 / 19.0))
        })
        .map(|(root, t)| point(root, t))
        .collect();
    UniformGroom { n_strands: n * n, n_particles: 20, points }
}

/// Summed angle between successive segments, degrees.
fn turning(strand: &[[f32; 3]]) -> f64 {
    let ways: Vec<Vector3<f64>> =
        strand.windows(2).map(|w| (Vector3::from(w[1]) - Vector3::from(w[0])).cast::<f64>()).collect();
    ways.windows(2).map(|w| w[0].angle(&w[1]).to_degrees()).sum()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn the_groom_s_own_strands_come_first_and_fewer_are_an_even_choice_of_them() {
    let groom = lock(5, |[x, z], t| [x, 3.0 * t, z]);
    assert_eq!(densify(&groom, 25, 1).unwrap(), groom);
    let more = densify(&groom, 100, 1).unwrap();
    assert_eq!(more.points[..groom.points.len()], groom.points);
    assert_eq!(more, densify(&groom, 100, 1).unwrap());
    assert_ne!(more, densify(&groom, 100, 2).unwrap());
    let fewer = densify(&groom, 5, 1).unwrap();
    assert_eq!((0..5).map(|s| fewer.strand(s)[0]).collect::<Vec<_>>(), [0, 5, 10, 15, 20].map(|s| groom.strand(s)[0]));
    assert!(matches!(densify(&groom, 0, 1), Err(Error::EmptyGroom)));
    assert!(matches!(densify(&UniformGroom::default(), 5, 1), Err(Error::EmptyGroom)));
}

#[test]
fn between_parallel_strands_only_parallel_ones_grow() {
    let groom = lock(6, |[x, z], t| [x + 2.0 * t, 3.0 * t, z]);
    let more = densify(&groom, 1_000, 3).unwrap();
    for s in 0..1_000 {
        let strand = more.strand(s);
        assert!((0.0..=5.0).contains(&strand[0][0]) && (0.0..=5.0).contains(&strand[0][2]), "{:?}", strand[0]);
        for (i, p) in strand.iter().enumerate() {
            let t = i as f32 / 19.0;
            let off = [p[0] - strand[0][0] - 2.0 * t, p[1] - 3.0 * t, p[2] - strand[0][2]];
            assert!(off.iter().all(|x| x.abs() < ROUND_OFF_CM), "strand {s}: {off:?}");
        }
    }
}

#[test]
fn every_strand_gets_its_share_of_new_ones() {
    let groom = lock(7, |[x, z], t| [x, 3.0 * t, z]);
    let more = densify(&groom, 49 * 41, 4).unwrap();
    let mut count = [0; 49];
    for s in 0..more.n_strands {
        let [x, _, z] = more.strand(s)[0];
        count[x.round() as usize + 7 * z.round() as usize] += 1;
    }
    // 41 each, give or take four standard deviations of as many independent choices of the nearest root.
    assert!(count.iter().all(|&n| (41 - 26..=41 + 26).contains(&n)), "{count:?}");
}

#[test]
fn nothing_grows_across_a_parting() {
    let groom = lock(8, |[x, z], t| [if x < 3.5 { x - 6.0 * t } else { x + 6.0 * t }, 2.0 * t, z]);
    let more = densify(&groom, 2_000, 5).unwrap();
    for s in 0..more.n_strands {
        let (root, tip) = (more.strand(s)[0], more.strand(s)[19]);
        assert!(((tip[0] - root[0]).abs() - 6.0).abs() < ROUND_OFF_CM, "{root:?} to {tip:?}");
        assert!(root[0] <= 3.0 + ROUND_OFF_CM || root[0] >= 4.0 - ROUND_OFF_CM, "{root:?} stands in the parting");
    }
}

#[test]
fn curls_of_any_phase_stay_curls() {
    let groom = lock(8, |[x, z], t| {
        let turn = 19.0 * t + 2.1 * x + 4.3 * z;
        [x + 0.6 * turn.cos(), 8.0 * t, z + 0.6 * turn.sin()]
    });
    let more = densify(&groom, 3_000, 6).unwrap();
    let of = |groom: &UniformGroom| median((0..groom.n_strands).map(|s| turning(groom.strand(s))).collect());
    assert!((of(&more) / of(&groom) - 1.0).abs() < 0.02, "{} of {} degrees", of(&more), of(&groom));
}

#[test]
fn real_grooms_keep_their_length_and_their_curls() {
    // Medians of new strands beside the groom's own. Guides that stand two centimetres apart differ in more than a cubic
    // can follow, so what grows between them bends a little more.
    const SAME: f64 = 0.1;
    for (name, unit, n_particles) in [
        ("grooms/man_hair_init_700.ply", LengthUnit::Cm, 25),
        ("grooms/curly_ball_1024_freefall.ply", LengthUnit::Cm, 41),
        ("grooms/sintel_lite_guides_32pts.tfx", LengthUnit::Cm, 25),
    ] {
        let Some(path) = shared_data(name) else { return };
        let groom = read_groom(&path, unit).unwrap().resample(n_particles).unwrap();
        let more = densify(&groom, 10_000, 7).unwrap();
        let all = |groom: &UniformGroom, of: &dyn Fn(&[[f32; 3]]) -> f64| {
            median((0..groom.n_strands).map(|s| of(groom.strand(s))).collect())
        };
        for of in [&arc_length as &dyn Fn(&[[f32; 3]]) -> f64, &turning] {
            let (before, after) = (all(&groom, of), all(&more, of));
            assert!((after / before - 1.0).abs() < SAME, "{name}: {after} of {before}");
        }
    }
}
