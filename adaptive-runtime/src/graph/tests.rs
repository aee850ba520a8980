//! The graph against its plain reading: every pair's ribbon and distance anew in every step.

use super::*;
use crate::test_model::{Noise, lattice};
use collision::clearance::strand_ribbon_keeps_clear;
use collision::{Shape, ShapeUnion, Solid, SolidPose};
use io_formats::guide_transform::Blend;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};

const RULE: EdgeRule =
    EdgeRule { similarity: true, distance: EdgeDistance::Motion, avoidance: true, gap_resolution: 0.5, gap_period: 1 };

/// A comb of nine teeth along -z, and a ball.
fn solids() -> Vec<Solid> {
    let tooth = |k: i32| Shape::Capsule {
        a: Vector3::new(0.5 * k as f32, 0.0, 0.0),
        b: Vector3::new(0.5 * k as f32, 0.0, -3.0),
        radius_a: 0.1,
        radius_b: 0.08,
    };
    let comb = ShapeUnion { shapes: (-4..=4).map(tooth).collect(), smoothing: 0.0 };
    let ball: ShapeUnion = Shape::sphere(Vector3::zeros(), 0.9).into();
    vec![
        Solid::from_shape("comb", &comb, 0.03, 0.08, 0.3).unwrap(),
        Solid::from_shape("ball", &ball, 0.06, 0.9, 0.3).unwrap(),
    ]
}

/// Poses at a step: both solids are drawn through the hair and back; the comb turns, and once it jumps.
fn poses(step: usize) -> [Isometry3<f64>; 2] {
    let t = step as f64 * 0.01;
    let jump = if step == 140 { 2.0 } else { 0.0 };
    let comb = Isometry3::from_parts(
        Translation3::new(4.0 + 0.5 * (3.0 * t).sin() + jump, -2.0 - 9.0 * t, 5.0 - 2.5 * (2.0 * t).sin()),
        UnitQuaternion::from_euler_angles(0.2 * t, 0.4 * (4.0 * t).sin(), 0.1),
    );
    [comb, Translation3::new(4.0 + 5.0 * (2.5 * t).sin(), -12.0, 1.3).into()]
}

struct Sweep {
    model: SkinningModel,
    solids: Vec<Solid>,
    position: Vec<[f32; 3]>,
    velocity: Vec<[f32; 3]>,
    in_solids: Vec<Vec<Vector3<f32>>>,
}

impl Sweep {
    fn new() -> Self {
        let model = lattice(8, 3, 17, 40, Blend::Translation);
        let n = model.n_guides() * model.n_particles as usize;
        let zeros = vec![[0.0; 3]; n];
        Self { position: zeros.clone(), velocity: zeros, in_solids: Vec::new(), solids: solids(), model }
    }

    /// Guides sway in waves that differ; one is lost for two steps.
    fn move_to(&mut self, step: usize) {
        let n = self.model.n_particles as usize;
        for g in 0..self.model.n_guides() {
            let rest = self.model.rest_of(g);
            let at_step = |i: usize, step: f32| {
                let s = i as f32 / (n - 1) as f32;
                let phase = 0.05 * step + 0.3 * g as f32;
                let sway = [0.9 * s * s * phase.sin(), 0.0, 0.7 * s * (1.3 * phase).cos()];
                [0, 1, 2].map(|c| rest[i][c] + sway[c])
            };
            for i in 0..n {
                let (now, before) = (at_step(i, step as f32), at_step(i, step as f32 - 1.0));
                self.position[g * n + i] = now;
                self.velocity[g * n + i] = [0, 1, 2].map(|c| (now[c] - before[c]) / 0.01);
            }
        }
        if (60..62).contains(&step) {
            self.position[5 * n + 9][1] = f32::NAN;
        }
        self.in_solids = poses(step)
            .iter()
            .map(|pose| {
                let from_world = pose.inverse().cast::<f32>();
                self.position.iter().map(|&p| (from_world * Point3::from(p)).coords).collect()
            })
            .collect();
    }

    fn motion(&self) -> GuideMotion<'_> {
        GuideMotion {
            n_particles: self.model.n_particles as usize,
            position_in_head: &self.position,
            velocity_in_head: &self.velocity,
            position_in_solids: &self.in_solids,
        }
    }

    fn moving(&self, step: usize) -> Vec<MovingSolid<'_>> {
        let pairs = self.solids.iter().zip(poses(step));
        pairs.map(|(solid, pose)| MovingSolid { solid, pose: SolidPose::still(pose) }).collect()
    }

    /// Edges and flips of each step.
    fn run(&mut self, n_steps: usize, rule: EdgeRule) -> Vec<(Vec<bool>, Vec<u32>)> {
        let mut graph = GuideGraph::new(&self.model);
        let mut out = Vec::new();
        for step in 0..n_steps {
            self.move_to(step);
            graph.update(&self.model, &self.motion(), &self.moving(step), rule);
            out.push((graph.connected.clone(), graph.flipped.clone()));
            for (&[i, j], &connected) in self.model.pairs.iter().zip(&graph.connected) {
                assert_eq!(graph.has_edge(i.into(), j.into()), connected);
                assert_eq!(graph.has_edge(j.into(), i.into()), connected);
            }
            let share = graph.connected.iter().filter(|&&c| c).count() as f64 / graph.connected.len() as f64;
            assert_eq!(graph.connectivity(), share);
        }
        out
    }

    /// The plain rule for one pair.
    fn plainly(&self, pair: usize, was: bool, rule: EdgeRule) -> bool {
        let n = self.model.n_particles as usize;
        let of = |g: u16| usize::from(g) * n..(usize::from(g) + 1) * n;
        let [i, j] = self.model.pairs[pair];
        let mut packed = PackedMotion::default();
        packed.pack(&self.motion());
        let distance = measure(&self.model, pair, &packed, &self.motion(), rule.distance);
        let free = |s: usize| {
            let solid = &self.solids[s];
            let (a, b) = (&self.in_solids[s][of(i)], &self.in_solids[s][of(j)]);
            strand_ribbon_keeps_clear(&solid.sdf, a, b, 0.0, rule.gap_resolution * solid.half_thickness_cm)
        };
        is_similar(&self.model, distance, was, rule) && (!rule.avoidance || (0..2).all(free))
    }
}

#[test]
fn every_edge_of_every_step_is_that_of_testing_all_pairs_anew() {
    const STEPS: usize = 260;
    for rule in [RULE, EdgeRule { similarity: false, ..RULE }] {
        let mut sweep = Sweep::new();
        let found = sweep.run(STEPS, rule);
        let mut connected = vec![true; sweep.model.pairs.len()];
        let (mut n_flips, mut n_lost) = (0, 0);
        for (step, (edges, flipped)) in found.iter().enumerate() {
            sweep.move_to(step);
            let expected: Vec<bool> = (0..connected.len()).map(|k| sweep.plainly(k, connected[k], rule)).collect();
            let flips: Vec<u32> =
                (0..connected.len()).filter(|&k| expected[k] != connected[k]).map(|k| k as u32).collect();
            assert_eq!(&expected, edges, "step {step}");
            assert_eq!(&flips, flipped, "step {step}");
            n_flips += flips.len();
            n_lost += expected.iter().filter(|&&c| !c).count();
            connected = expected;
        }
        let all = STEPS * connected.len();
        assert!(n_flips > 500, "little happened: {n_flips} flips");
        assert!(n_lost > all / 20 && n_lost < all * 19 / 20, "{n_lost} of {all} without edge");
    }
}

#[test]
fn edges_asked_for_are_those_of_asking_for_all_and_others_stay() {
    const STEPS: usize = 260;
    // Without memory of its own, an edge is what the present step makes of it.
    let rule = EdgeRule { similarity: false, ..RULE };
    let all = Sweep::new().run(STEPS, rule);
    for gap_period in [1, 8] {
        let mut sweep = Sweep::new();
        let mut graph = GuideGraph::new(&sweep.model);
        let mut before = (vec![true; sweep.model.pairs.len()], vec![false; sweep.model.pairs.len()]);
        let (mut n_asked, mut n_kept) = (0, 0);
        for (step, (expected, _)) in all.iter().enumerate() {
            sweep.move_to(step);
            // Some are asked for for ten steps on end, and again after twenty.
            let guides: Vec<u16> = (0..sweep.model.n_guides() as u16)
                .filter(|&g| (usize::from(g) + step / 10).is_multiple_of(3))
                .collect();
            graph.ask_none();
            graph.ask_among(&guides);
            graph.update(&sweep.model, &sweep.motion(), &sweep.moving(step), EdgeRule { gap_period, ..rule });
            let is_asked = |&[i, j]: &[u16; 2]| guides.contains(&i) && guides.contains(&j);
            let asked: Vec<bool> = sweep.model.pairs.iter().map(is_asked).collect();
            for k in 0..asked.len() {
                if !asked[k] {
                    assert_eq!(graph.connected[k], before.0[k], "step {step}, pair {k} was not asked for");
                    n_kept += usize::from(graph.connected[k] != expected[k]);
                } else if gap_period == 1 || !before.1[k] {
                    assert_eq!(graph.connected[k], expected[k], "step {step}, pair {k}, period {gap_period}");
                    n_asked += 1;
                }
            }
            before = (graph.connected.clone(), asked);
        }
        assert!(
            n_asked > 300 && n_kept > 500,
            "little happened: {n_asked} asked for, {n_kept} kept though they changed"
        );
    }
}

#[test]
fn edges_are_the_same_for_any_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Sweep::new().run(80, RULE))
    };
    let one = run(1);
    for threads in [2, 8] {
        assert_eq!(run(threads), one);
    }
}

#[test]
fn tips_further_apart_than_the_threshold_share_no_edge() {
    const D_MAX_CM: f32 = 2.0;
    let rule = EdgeRule { distance: EdgeDistance::Tips { d_max_cm: D_MAX_CM }, avoidance: false, ..RULE };
    let mut sweep = Sweep::new();
    let found = sweep.run(50, rule);
    let n = sweep.model.n_particles as usize;
    let mut counts = [0; 2];
    for (step, (edges, _)) in found.iter().enumerate() {
        sweep.move_to(step);
        for (&[i, j], &edge) in sweep.model.pairs.iter().zip(edges) {
            let tip = |g: u16| Vector3::from(sweep.position[(usize::from(g) + 1) * n - 1]);
            assert_eq!(edge, (tip(i) - tip(j)).norm() < D_MAX_CM);
            counts[usize::from(edge)] += 1;
        }
    }
    assert!(counts.iter().all(|&c| c > 500), "the threshold was to part some: {counts:?}");
}

#[test]
fn a_ribbon_within_its_budget_is_called_free_wherever_it_is_moved() {
    // The argument of `Standing`, tried where it is tightest: a budget just above zero, moved by all of it.
    let mut noise = Noise::new(11);
    let mut tried = 0;
    for solid in solids() {
        let standing = collision::clearance::Standing::of(&solid.sdf);
        let bounds = solid.sdf.bounds().grown(0.2);
        for _ in 0..40_000 {
            let mut point = || bounds.min + bounds.size().map(|s| s * noise.next());
            let corners = [point(), point(), point(), point()];
            let shrink = 0.02 + 0.2 * noise.next();
            let middle = corners.iter().sum::<Vector3<f32>>() * 0.25;
            let corners = corners.map(|c| middle + (c - middle) * shrink);
            let radius = corners.iter().map(|c| (c - middle).norm()).fold(0.0, f32::max);
            let budget = standing.budget(middle, radius);
            if !(budget > 0.0 && budget < 0.2) {
                continue;
            }
            tried += 1;
            // Straight at the solid.
            let (_, normal) = solid.sdf.outward_normal(middle);
            let moved = corners.map(|c| c - normal * (0.999 * budget));
            let resolution = 0.5 * solid.half_thickness_cm;
            assert!(collision::ribbon_is_free(&solid.sdf, moved, resolution), "budget {budget}, radius {radius}");
        }
    }
    assert!(tried > 1000, "only {tried} budgets were tried");
}

#[test]
fn a_check_spread_over_steps_is_never_older_than_its_period() {
    const PERIOD: usize = 4;
    let rule = EdgeRule { similarity: false, gap_period: PERIOD as u32, ..RULE };
    let mut sweep = Sweep::new();
    let found = sweep.run(200, rule);
    let mut lately: Vec<Vec<bool>> = Vec::new();
    let mut n_late = 0;
    for (step, (edges, _)) in found.iter().enumerate() {
        sweep.move_to(step);
        lately.push((0..edges.len()).map(|k| sweep.plainly(k, true, rule)).collect());
        let lately = &lately[(step + 1).saturating_sub(PERIOD)..];
        for (k, &edge) in edges.iter().enumerate() {
            assert!(lately.iter().any(|plain| plain[k] == edge), "step {step}, pair {k}");
            n_late += usize::from(lately[lately.len() - 1][k] != edge);
        }
    }
    assert!(n_late > 0, "nothing was late: the check was not spread");
}
