//! Repulsion keeps momentum, stops what approaches, never pulls, and leaves kinematic and linked hair alone.

use crate::scenes::{Random, Scene, with_any_thread_count};
use nalgebra::Vector3;
use strand_sim::interaction::{
    LinkSet, NearPairs, RepulsionParams, RepulsionReport, StictionParams, StictionWorkspace, repel,
};

const DT: f64 = 5e-4;

/// Sums over ten thousand particles of numbers known to 1e-16.
const ROUND_OFF: f64 = 1e-12;

fn thick(friction: f64) -> RepulsionParams {
    RepulsionParams { thickness_cm: 0.15, friction, ..RepulsionParams::standard() }
}

fn repelled(scene: &Scene, params: &RepulsionParams, links: &LinkSet) -> (Scene, RepulsionReport) {
    let mut near = NearPairs::default();
    near.find(&scene.strands(), params.thickness_cm);
    let mut after = scene.clone();
    let report = repel(&scene.strands(), near.pairs(), links, params, DT, &mut after.velocity);
    (after, report)
}

#[test]
fn linear_momentum_is_kept_to_round_off() {
    let scene = Scene::tangle(1, 400, 6.0, 200.0);
    let (after, report) = repelled(&scene, &thick(0.4), &LinkSet::default());
    assert!(report.pushed > 500, "{report:?}");
    assert!((after.momentum() - scene.momentum()).norm() < ROUND_OFF * scene.momentum_scale());
    assert_ne!(after.velocity, scene.velocity);
}

#[test]
fn angular_momentum_is_kept_without_friction() {
    let scene = Scene::tangle(2, 400, 6.0, 200.0);
    let (after, report) = repelled(&scene, &thick(0.0), &LinkSet::default());
    assert!(report.pushed > 500, "{report:?}");
    let scale = 10.0 * scene.momentum_scale();
    assert!((after.angular_momentum() - scene.angular_momentum()).norm() < ROUND_OFF * scale);
}

#[test]
fn roots_stay_and_what_meets_them_is_stopped() {
    let scene = Scene::tangle(3, 400, 6.0, 200.0).with_roots(8);
    let (after, report) = repelled(&scene, &thick(0.4), &LinkSet::default());
    assert!(report.pushed > 300);
    for (p, w) in scene.inv_mass.iter().enumerate() {
        assert!(*w > 0.0 || after.velocity[p] == scene.velocity[p]);
    }
}

/// Two crossed segments `gap` apart, the upper one moving at `velocity`; relative velocity of their middles afterwards.
fn crossed_pair(gap: f64, velocity: Vector3<f64>, params: &RepulsionParams) -> (Vector3<f64>, f64) {
    let mut scene = Scene::new(2);
    scene.position = vec![-Vector3::x(), Vector3::x(), Vector3::new(0.0, -1.0, gap), Vector3::new(0.0, 1.0, gap)];
    scene.velocity = vec![Vector3::zeros(), Vector3::zeros(), velocity, velocity];
    scene.inv_mass = vec![1.0 / 2.5e-5; 4];
    let (after, _) = repelled(&scene, params, &LinkSet::default());
    let v = &after.velocity;
    ((v[2] + v[3] - v[0] - v[1]) * 0.5, after.energy() - scene.energy())
}

#[test]
fn an_approach_is_stopped_and_the_overlap_given_back_slowly() {
    let params = thick(0.0);
    let (relative, energy) = crossed_pair(0.05, Vector3::new(0.0, 0.0, -100.0), &params);
    assert!(energy < 0.0);
    // Neither faster than a share of the overlap a step, nor than the spring can push: two middles of 5e-5 g each.
    let overlap = params.thickness_cm - 0.05;
    let limit = (params.max_share * overlap / DT).min(DT * params.stiffness * overlap * 2.0 / 5e-5);
    assert!((relative.z - limit).abs() < ROUND_OFF * 100.0, "{} against {limit}", relative.z);
}

#[test]
fn repulsion_never_pulls() {
    for speed in [0.0, 1.0, 50.0, 1e4] {
        let (relative, _) = crossed_pair(0.05, Vector3::new(0.0, 0.0, speed), &thick(0.3));
        assert!(relative.z >= speed);
    }
    let (beyond, _) = crossed_pair(0.2, Vector3::new(0.0, 0.0, -100.0), &thick(0.3));
    assert_eq!(beyond.z, -100.0);
}

#[test]
fn friction_obeys_coulomb() {
    // Pressed on at 100 cm/s, friction may take 0.3 · 100 and what the spring adds.
    let frictionless = crossed_pair(0.05, Vector3::new(50.0, 0.0, -100.0), &thick(0.0)).0;
    assert!((frictionless.x - 50.0).abs() < ROUND_OFF * 50.0);
    let normal_change = frictionless.z + 100.0;
    let slips = crossed_pair(0.05, Vector3::new(50.0, 0.0, -100.0), &thick(0.3)).0;
    assert!((50.0 - slips.x - 0.3 * normal_change).abs() < ROUND_OFF * 100.0, "{slips:?}");
    let sticks = crossed_pair(0.05, Vector3::new(20.0, 5.0, -100.0), &thick(0.3)).0;
    assert!(sticks.x.abs() < ROUND_OFF * 100.0 && sticks.y.abs() < ROUND_OFF * 100.0);
}

#[test]
fn linked_pairs_are_not_repelled() {
    let scene = Scene::tangle(4, 100, 4.0, 200.0);
    let mut near = NearPairs::default();
    near.find(&scene.strands(), 0.15);
    let params = StictionParams { make_cm: 0.15, break_cm: 0.3, max_links: 16, ..StictionParams::dry() };
    let mut links = LinkSet::default();
    links.update(&scene.strands(), near.pairs(), &params, &mut StictionWorkspace::default());
    assert_eq!(links.links().len(), near.pairs().len(), "sixteen places suffice here");
    assert!(!near.pairs().is_empty());
    let (after, report) = repelled(&scene, &thick(0.3), &links);
    assert_eq!(report.touching, 0);
    assert_eq!(after.velocity, scene.velocity);
}

#[test]
fn repulsion_does_not_depend_on_the_thread_count() {
    let scene = Scene::tangle(5, 2_000, 10.0, 200.0);
    with_any_thread_count(|| repelled(&scene, &thick(0.3), &LinkSet::default()).0.velocity);
}

#[test]
fn near_pairs_are_exactly_those_within_reach() {
    let mut random = Random::new(6);
    let scene = Scene::tangle(7, 60, 3.0 + random.unit(), 0.0).with_roots(3);
    let strands = scene.strands();
    let mut near = NearPairs::default();
    near.find(&strands, 0.2);
    let mut expected = Vec::new();
    let n = strands.n_segments();
    for i in 0..n {
        for j in i + 1..n {
            let c = collision::segment_pair::closest_points(&strands.segment(i), &strands.segment(j));
            let same_strand = i / 24 == j / 24;
            let all_kinematic = i % 24 < 2 && j % 24 < 2;
            if c.distance2 < 0.2 * 0.2 && !(same_strand && j - i < 4) && !all_kinematic {
                expected.push((i as u32, j as u32));
            }
        }
    }
    assert!(expected.len() > 100);
    assert_eq!(near.pairs().iter().map(|p| (p.i, p.j)).collect::<Vec<_>>(), expected);
}
