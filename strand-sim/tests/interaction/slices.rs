//! Sampled contacts: what planes see of hair in contact, and impulses given block by block.

use crate::scenes::{Random, Scene, with_any_thread_count};
use collision::segment_pair::closest_points;
use collision::spatial_hash::Pair;
use nalgebra::Vector3;
use std::collections::HashSet;
use strand_sim::interaction::{
    Blocks, ContactSampling, LinkSet, Near, NearPairs, RepulsionParams, RepulsionReport, SliceSearch, repel,
};

const DT: f64 = 5e-3;

/// Sums over ten thousand particles of numbers known to 1e-16.
const ROUND_OFF: f64 = 1e-12;

const THICK: RepulsionParams = RepulsionParams { thickness_cm: 0.15, stiffness: 1.0, max_share: 0.1, friction: 0.3 };

const UNCAPPED: ContactSampling = ContactSampling { spacing_cm: 0.2, window: 3.0, max_contacts: 16 };

fn named(scene: &Scene, thickness_cm: f64, sampling: &ContactSampling) -> Blocks {
    let mut blocks = Blocks::default();
    SliceSearch::default().find(&scene.strands(), thickness_cm, sampling, &mut blocks);
    blocks
}

fn rubbed(scene: &Scene, params: &RepulsionParams) -> (Scene, RepulsionReport) {
    let mut after = scene.clone();
    let mut blocks = named(scene, params.thickness_cm, &UNCAPPED);
    let report = blocks.repel(&scene.strands(), params, DT, &mut after.velocity);
    (after, report)
}

/// Straight strands side by side, up to a hundredth of a radian from parallel.
fn combed(seed: u64, n_strands: usize) -> Scene {
    let mut random = Random::new(seed);
    let mut scene = Scene::new(25);
    for _ in 0..n_strands {
        let root = Vector3::new(2.0 * random.unit(), 3.0 * random.unit(), 2.0 * random.unit());
        let along = (Vector3::new(0.3, 1.0, 0.2) + random.in_cube(0.005)).normalize();
        for i in 0..25 {
            scene.position.push(root + along * f64::from(i));
            scene.velocity.push(random.in_cube(10.0));
            scene.inv_mass.push(1.0 / 2.5e-5);
        }
    }
    scene
}

#[test]
fn hairs_in_contact_along_each_other_are_never_missed() {
    // Over one spacing two hairs of this scene part by less than the fifth of the thickness left out below.
    const SPACING_CM: f64 = 0.5;
    const THICKNESS_CM: f64 = 0.08;
    let scene = combed(1, 300);
    let strands = scene.strands();
    let sampling = ContactSampling { spacing_cm: SPACING_CM, ..UNCAPPED };
    let found: HashSet<[u32; 2]> = named(&scene, THICKNESS_CM, &sampling).pairs().collect();
    let mut near = NearPairs::default();
    near.find(&strands, 0.8 * THICKNESS_CM);
    let mut looked_at = 0;
    for pair in near.pairs() {
        let [a, b] = [pair.i, pair.j].map(|s| strands.segment(s as usize));
        if a[1].y.min(b[1].y) - a[0].y.max(b[0].y) > SPACING_CM {
            looked_at += 1;
            assert!(found.contains(&[pair.i, pair.j]), "{pair:?}");
        }
    }
    assert!(looked_at > 500, "{looked_at}");
}

#[test]
fn a_pair_is_named_once_and_touches_only_if_it_is_near() {
    for scene in [combed(2, 300), Scene::tangle(3, 800, 4.0, 200.0)] {
        let mut blocks = named(&scene, THICK.thickness_cm, &UNCAPPED);
        let pairs: Vec<_> = blocks.pairs().collect();
        let distinct: HashSet<_> = pairs.iter().copied().collect();
        assert!(pairs.len() > 500, "{}", pairs.len());
        assert_eq!(pairs.len(), distinct.len());
        let mut near = NearPairs::default();
        near.find(&scene.strands(), THICK.thickness_cm);
        let both = near.pairs().iter().filter(|p| distinct.contains(&[p.i, p.j])).count();
        let report = blocks.repel(&scene.strands(), &THICK, DT, &mut scene.velocity.clone());
        assert_eq!(report.touching, both);
    }
}

#[test]
fn no_cut_keeps_more_contacts_than_it_may() {
    let scene = combed(4, 600);
    let all = named(&scene, 0.3, &UNCAPPED).pairs().count();
    let few = named(&scene, 0.3, &ContactSampling { max_contacts: 1, ..UNCAPPED });
    let n_cuts = scene.strands().n_segments() * 6;
    assert!(few.pairs().count() < all && few.pairs().count() <= n_cuts, "{} of {all}", few.pairs().count());
}

#[test]
fn blocks_do_what_one_pair_after_the_other_does() {
    let scene = Scene::tangle(5, 2_000, 6.0, 200.0).with_roots(2);
    let strands = scene.strands();
    let mut blocks = named(&scene, THICK.thickness_cm, &UNCAPPED);
    let in_order: Vec<_> = blocks
        .pairs()
        .map(|[i, j]| {
            let c = closest_points(&strands.segment(i as usize), &strands.segment(j as usize));
            Pair { i, j, data: Near { s: c.s, t: c.t, offset: c.offset } }
        })
        .collect();
    let mut plain = scene.velocity.clone();
    let expected = repel(&strands, &in_order, &LinkSet::default(), &THICK, DT, &mut plain);
    let mut fast = scene.velocity.clone();
    let report = blocks.repel(&strands, &THICK, DT, &mut fast);
    assert!(report.pushed > 500, "{report:?}");
    assert_eq!(report, expected);
    assert!(fast == plain, "not the same bits");
}

#[test]
fn rubbing_keeps_momentum_and_takes_energy() {
    let scene = Scene::tangle(6, 2_000, 6.0, 200.0);
    // Without the spring, which gives overlap back as motion.
    let (after, report) = rubbed(&scene, &RepulsionParams { stiffness: 0.0, ..THICK });
    assert!(report.pushed > 500, "{report:?}");
    assert!((after.momentum() - scene.momentum()).norm() < ROUND_OFF * scene.momentum_scale());
    let (frictionless, _) = rubbed(&scene, &RepulsionParams { stiffness: 0.0, friction: 0.0, ..THICK });
    assert!(frictionless.energy() < scene.energy());
    assert!(after.energy() < frictionless.energy());
}

#[test]
fn sampled_contacts_do_not_depend_on_the_thread_count() {
    let scene = Scene::tangle(7, 2_000, 6.0, 200.0);
    with_any_thread_count(|| {
        (named(&scene, 0.15, &UNCAPPED).pairs().collect::<Vec<_>>(), rubbed(&scene, &THICK).0.velocity)
    });
}

#[test]
fn what_is_not_finite_meets_nothing() {
    let mut scene = Scene::tangle(8, 100, 3.0, 200.0);
    for bad in [f64::NAN, f64::INFINITY, -f64::INFINITY] {
        scene.position[30].x = bad;
        let blocks = named(&scene, 0.15, &UNCAPPED);
        assert!(blocks.pairs().count() > 20);
        assert!(blocks.pairs().flatten().all(|segment| segment != 29 && segment != 28));
    }
}

/// Speed along z (cm/s) after half a second of a hair that lies at a slant on one driven along itself with an
/// acceleration, pressed on it by gravity alone.
fn dragged(acceleration: f64, sampled: bool) -> f64 {
    const GRAVITY: f64 = 981.0;
    const STEPS: usize = 100;
    let params = RepulsionParams { thickness_cm: 0.2, ..THICK };
    let mut scene = Scene::new(2);
    let half = Vector3::new(0.3, 0.0, 1.0);
    let above = Vector3::y() * 0.19;
    scene.position = vec![-Vector3::z() * 400.0, Vector3::z() * 400.0, above - half, above + half];
    scene.velocity = vec![Vector3::zeros(); 4];
    scene.inv_mass = vec![0.0, 0.0, 1.0 / 2.5e-5, 1.0 / 2.5e-5];
    for step in 0..STEPS {
        for k in 0..2 {
            scene.velocity[k].z = acceleration * DT * (step + 1) as f64;
            scene.velocity[2 + k].y -= GRAVITY * DT;
        }
        let mut velocity = scene.velocity.clone();
        if sampled {
            let mut blocks = named(&scene, params.thickness_cm, &ContactSampling { spacing_cm: 0.5, ..UNCAPPED });
            blocks.repel(&scene.strands(), &params, DT, &mut velocity);
        } else {
            let mut near = NearPairs::default();
            near.find(&scene.strands(), params.thickness_cm);
            repel(&scene.strands(), near.pairs(), &LinkSet::default(), &params, DT, &mut velocity);
        }
        scene.velocity = velocity;
        for (x, v) in scene.position.iter_mut().zip(&scene.velocity) {
            *x += v * DT;
        }
        // The driven hair stays under the other: it is as long as need be.
        for k in 0..2 {
            scene.position[k].z -= scene.velocity[k].z * DT;
        }
    }
    0.5 * (scene.velocity[2].z + scene.velocity[3].z)
}

#[test]
fn a_hair_is_dragged_along_below_coulombs_limit_and_slides_above_it() {
    // Half a second; the limit is 0.3 · 981 cm/s². The spring that gives overlap back bounces it by a few per cent.
    const BOUNCE: f64 = 0.05;
    let limit = THICK.friction * 981.0;
    for sampled in [false, true] {
        let stuck = dragged(0.5 * limit, sampled);
        assert!((stuck / (0.25 * limit) - 1.0).abs() < BOUNCE, "sampled {sampled}: {stuck} of {}", 0.25 * limit);
        let slid = dragged(3.0 * limit, sampled);
        assert!((slid / (0.5 * limit) - 1.0).abs() < BOUNCE, "sampled {sampled}: {slid} of {}", 0.5 * limit);
    }
}
