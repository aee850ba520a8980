//! Laws of one interactive step (AS16 §4, §5) on a small model made by hand.

use adaptive_runtime::{CliqueRule, Correction, Error, Runtime, RuntimeParams, StepInput, StepReport, TwoWaySolve};
use collision::Solid;
use hair_bench::shapes::{self, CombParams};
use hair_tests::models::{N_PARTICLES, Row};
use hair_tests::scenes::{ball, dense_samples, rod};
use hair_tests::tolerance::{INSIDE_CM, SINGLE_ROUND_OFF_CM};
use io_formats::SkinningModel;
use io_formats::guide_transform::Blend;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

const DT: f64 = 0.01;

/// Particles at the root that sit in the scalp.
const FIRST_FREE: usize = 2;

fn still() -> Isometry3<f64> {
    Isometry3::identity()
}

fn at(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    Translation3::new(x, y, z).into()
}

fn weightless(mut params: RuntimeParams) -> RuntimeParams {
    params.guides.gravity = Vector3::zeros();
    params
}

fn runtime(model: SkinningModel, params: RuntimeParams, solids: Vec<Solid>, poses: &[Isometry3<f64>]) -> Runtime {
    Runtime::new(model, params, still(), None, solids, poses).unwrap()
}

fn step(runtime: &mut Runtime, poses: &[Isometry3<f64>]) -> StepReport {
    let report = runtime.step(&StepInput { dt: DT, world_from_head: still(), world_from_solids: poses });
    runtime.read();
    report
}

fn rest(model: &SkinningModel) -> Vec<[f32; 3]> {
    (0..model.n_strands as usize).flat_map(|s| model.rest_of(s).to_vec()).collect()
}

fn strand_of(runtime: &Runtime, strand: usize) -> Vec<Vector3<f64>> {
    let n = runtime.n_particles();
    runtime.positions()[strand * n..][..n].iter().map(|&p| Vector3::from(p).cast()).collect()
}

fn distance(a: [f32; 3], b: Vector3<f64>) -> f64 {
    (Vector3::from(a).cast::<f64>() - b).norm()
}

#[test]
fn hair_at_rest_is_reproduced_exactly() {
    for (row, blend) in [
        (Row::parted(), Blend::Translation),
        (Row::parted(), Blend::Rigid),
        (Row::of_three_guides(), Blend::Translation),
    ] {
        let model = SkinningModel { blend, ..row.model() };
        let rest = rest(&model);
        let mut runtime = runtime(model, RuntimeParams::adaptive(), vec![], &[]);
        assert_eq!(runtime.positions(), rest);
        let guides = runtime.guides_in_head().to_vec();
        runtime.replay(&guides, &still());
        assert_eq!(runtime.positions(), rest);
    }
}

#[test]
fn rigid_head_motion_is_reproduced_exactly() {
    for blend in [Blend::Translation, Blend::Rigid] {
        let model = SkinningModel { blend, ..Row::parted().model() };
        let rest = rest(&model);
        let mut runtime = runtime(model, RuntimeParams::adaptive(), vec![], &[]);
        let guides = runtime.guides_in_head().to_vec();
        for k in 0..20 {
            let turn = UnitQuaternion::from_euler_angles(0.1 * f64::from(k), 0.3 * f64::from(k), -0.05 * f64::from(k));
            let head = Isometry3::from_parts(Translation3::new(f64::from(k), 2.0, -0.5 * f64::from(k)), turn);
            runtime.replay(&guides, &head);
            for (now, rest) in runtime.positions().iter().zip(&rest) {
                let expected = head * Point3::from(Vector3::from(*rest).cast::<f64>());
                assert!(distance(*now, expected.coords) < SINGLE_ROUND_OFF_CM);
            }
        }
    }
}

#[test]
fn hair_at_rest_without_gravity_is_not_moved_by_steps() {
    let model = Row::of_three_guides().model();
    let rest = rest(&model);
    let mut runtime = runtime(model, weightless(RuntimeParams::adaptive()), vec![], &[]);
    for _ in 0..100 {
        let report = step(&mut runtime, &[]);
        assert_eq!((report.set_changes, report.corrected_strands, report.quarantined), (0, 0, 0));
    }
    for (now, rest) in runtime.positions().iter().zip(&rest) {
        assert!(distance(*now, Vector3::from(*rest).cast()) < SINGLE_ROUND_OFF_CM);
    }
}

#[test]
fn a_hair_with_one_guide_follows_it_exactly() {
    let row = Row::parted();
    let model = row.model();
    let guides = model.guide_strands.clone();
    let mut runtime = runtime(model, RuntimeParams::adaptive(), vec![], &[]);
    for _ in 0..50 {
        step(&mut runtime, &[]);
    }
    let simulated = runtime.guides_in_head();
    for (g, &s) in guides.iter().enumerate() {
        for (i, p) in strand_of(&runtime, s as usize).iter().enumerate() {
            assert!(distance(simulated[g * N_PARTICLES + i], *p) < SINGLE_ROUND_OFF_CM, "guide {g}, particle {i}");
        }
    }
}

/// The parted row with a rod standing in the gap between its halves, after some steps; sets are left as soon as they break.
fn divided_by_a_rod() -> (Row, Runtime) {
    divided_by_a_rod_with(RuntimeParams::adaptive())
}

fn divided_by_a_rod_with(mut params: RuntimeParams) -> (Row, Runtime) {
    params.assign.leave_gain_cm = -1.0;
    let row = Row::parted();
    let pose = [at(0.0, -9.0, 0.1)];
    let mut runtime = runtime(row.model(), weightless(params), vec![rod(0.2, 4.0, 0.2)], &pose);
    let straddles = |r: &Runtime, s: usize| {
        let left = |g: &u16| row.x[row.guides[usize::from(*g)] as usize] < 0.0;
        r.guide_set(s).iter().any(left) && !r.guide_set(s).iter().all(left)
    };
    assert!((0..row.x.len()).any(|s| straddles(&runtime, s)), "sets were to reach across before the rod is seen");
    for _ in 0..5 {
        step(&mut runtime, &pose);
    }
    (row, runtime)
}

#[test]
fn hairs_parted_by_a_rod_follow_guides_of_one_side() {
    let (row, runtime) = divided_by_a_rod();
    let side = |strand: u32| row.x[strand as usize] < 0.0;
    for (i, &a) in row.guides.iter().enumerate() {
        for (j, &b) in row.guides.iter().enumerate().filter(|&(j, _)| j != i) {
            assert_eq!(runtime.graph().has_edge(i, j), side(a) == side(b), "guides {i} and {j}");
        }
    }
    for s in 0..row.x.len() {
        let set = runtime.guide_set(s);
        let first = side(row.guides[usize::from(set[0])]);
        assert!(set.iter().all(|&g| side(row.guides[usize::from(g)]) == first), "strand {s} follows {set:?}");
    }
}

#[test]
fn clusters_are_cliques_of_the_guide_graph() {
    let mut params = RuntimeParams::adaptive();
    params.assign.cliques = CliqueRule::Grown;
    let (row, runtime) = divided_by_a_rod_with(params);
    let (graph, clusters) = (runtime.graph(), runtime.clusters());
    assert!(graph.connectivity() < 1.0);
    assert_eq!(clusters.n(), row.guides.len());
    for center in 0..clusters.n() {
        assert!(clusters.contains(center, center));
        let members: Vec<usize> = clusters.members(center).collect();
        for &a in &members {
            for &b in members.iter().filter(|&&b| b != a) {
                assert!(graph.has_edge(a, b), "cluster {center} holds {a} and {b}");
            }
        }
        // Grown as far as it goes: no guide connected to all members is left out.
        for other in (0..clusters.n()).filter(|g| !members.contains(g)) {
            assert!(members.iter().any(|&m| !graph.has_edge(m, other)), "cluster {center} could hold {other}");
        }
    }
}

#[test]
fn sets_grow_back_when_the_solid_has_gone() {
    let (row, mut runtime) = divided_by_a_rod();
    let size = |r: &Runtime| (0..row.x.len()).map(|s| r.guide_set(s).len()).sum::<usize>();
    let parted = size(&runtime);
    let gone = [at(0.0, -9.0, 200.0)];
    for _ in 0..100 {
        step(&mut runtime, &gone);
    }
    assert!(runtime.graph().connectivity() > 0.99);
    assert!(size(&runtime) > parted, "{} guides in all sets after {parted}", size(&runtime));
}

#[test]
fn hair_that_nothing_holds_is_skinned_as_fixed_sets_skin_it() {
    // The head swings hard enough to part guides; no solid is there.
    let run = |params: RuntimeParams| {
        let mut runtime = runtime(Row::parted().model(), params, vec![], &[]);
        let (mut changes, mut least) = (0, 1.0f64);
        for k in 1..=60 {
            let head = Isometry3::rotation(Vector3::y() * 1.2 * (0.12 * f64::from(k)).sin());
            let report = runtime.step(&StepInput { dt: DT, world_from_head: head, world_from_solids: &[] });
            changes += report.set_changes;
            least = least.min(report.connectivity);
            runtime.read();
        }
        (changes, least, runtime.positions().to_vec())
    };
    let mut at_once = RuntimeParams::adaptive();
    at_once.assign.leave_gain_cm = -1.0;
    let (changes, connectivity, _) = run(at_once);
    assert!(changes > 0 && connectivity < 1.0, "guides were to part");
    let (changes, _, positions) = run(RuntimeParams::adaptive());
    assert_eq!(changes, 0);
    assert_eq!(positions, run(RuntimeParams::fixed()).2);
}

#[test]
fn without_adaption_sets_never_change() {
    let row = Row::parted();
    let pose = [at(0.0, -9.0, 0.1)];
    let mut runtime = runtime(row.model(), RuntimeParams::fixed(), vec![rod(0.2, 4.0, 0.2)], &pose);
    let sets: Vec<Vec<u16>> = (0..row.x.len()).map(|s| runtime.guide_set(s).to_vec()).collect();
    for _ in 0..20 {
        assert_eq!(step(&mut runtime, &pose).set_changes, 0);
    }
    for (s, set) in sets.iter().enumerate() {
        assert_eq!(runtime.guide_set(s), set);
    }
}

#[test]
fn effective_guides_lie_between_one_and_the_size_of_the_set() {
    let (row, runtime) = divided_by_a_rod();
    for s in 0..row.x.len() {
        let n = runtime.guide_set(s).len() as f64;
        let effective = runtime.effective_guides(s);
        // Only weights that are not negative and sum to one give this.
        assert!((1.0 - 1e-6..=n + 1e-6).contains(&effective), "strand {s}: {effective} of {n}");
    }
}

#[test]
fn the_weights_told_are_those_of_the_set_and_sum_to_one() {
    /// Nine weights in f32.
    const ROUND_OFF: f32 = 1e-6;
    let (row, runtime) = divided_by_a_rod();
    for s in 0..row.x.len() {
        let mut squares = 0.0;
        for i in 0..runtime.n_particles() {
            let (guides, weights): (Vec<u16>, Vec<f32>) = runtime.weights(s, i).unzip();
            assert_eq!(guides, runtime.guide_set(s));
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < ROUND_OFF, "strand {s} at {i}: {weights:?}");
            squares += 1.0 / f64::from(weights.iter().map(|w| w * w).sum::<f32>());
        }
        let effective = squares / runtime.n_particles() as f64;
        assert!((effective - runtime.effective_guides(s)).abs() < f64::from(ROUND_OFF), "strand {s}: {effective}");
    }
}

#[test]
fn hardly_a_hair_gets_into_a_slow_tooth_and_none_through() {
    /// Largest share of strands by the tooth that may be inside it, over all steps: what the project promises of a comb.
    const INSIDE_SHARE: f64 = 0.02;
    /// Distance from the tooth at which a strand counts as by it, cm.
    const BY_CM: f32 = 0.3;
    let row = Row::parted();
    let radius = 0.12;
    let tooth = rod(radius, 6.0, 0.1);
    let pose = |k: usize| [at(-5.0 + 0.05 * k as f64, -9.0, 0.3)];
    let mut runtime = runtime(row.model(), RuntimeParams::adaptive(), vec![tooth.clone()], &pose(0));
    let (mut least, mut by, mut inside) = (f32::INFINITY, 0, 0);
    for k in 1..=200 {
        assert_eq!(step(&mut runtime, &pose(k)).quarantined, 0);
        let solid_from_world = pose(k)[0].inverse();
        let distance = |p: &Vector3<f64>| tooth.sdf.distance((solid_from_world * Point3::from(*p)).coords.cast());
        for s in 0..row.x.len() {
            let samples = dense_samples(&strand_of(&runtime, s), FIRST_FREE);
            let nearest = samples.iter().map(distance).fold(f32::INFINITY, f32::min);
            least = least.min(nearest);
            by += usize::from(nearest < BY_CM);
            inside += usize::from(nearest < -INSIDE_CM);
        }
    }
    assert!(by > 1000, "the tooth was to meet hair: {by}");
    assert!(inside as f64 <= INSIDE_SHARE * by as f64, "{inside} of {by} inside");
    // Half way in would be half way through.
    assert!(least > -0.5 * radius, "got {} cm deep", -least);
}

#[test]
fn hair_that_a_fast_comb_has_left_is_soon_where_its_guides_have_it() {
    /// How far from there it may be half a second later, cm.
    const LEFT_CM: f64 = 1.0;
    /// The farthest that the comb's teeth, 4 mm apart, hold it off, cm; hair that was flung went 13 cm.
    const HELD_CM: f64 = 2.0;
    /// A metre a second, cm for each step.
    const STEP_CM: f64 = 1.0;
    let row = Row::parted();
    let comb = shapes::comb(CombParams { teeth: 19, ..CombParams::dressing() }).unwrap();
    let corrected = RuntimeParams::no_two_way();
    let mut guided = corrected;
    guided.residual.correction = Correction::None;
    for aside in [0.0, 0.1, 0.2, 0.3] {
        // Into the hair from the front, down and out of it, then far from it for half a second.
        let pose = |k: usize| match k {
            0..=30 => [at(aside, -3.0, 8.0 - 0.19 * k as f64)],
            _ => [at(aside, -3.0 - STEP_CM * (k - 30).min(30) as f64, 2.3)],
        };
        let start = |params| runtime(row.model(), params, vec![comb.clone()], &pose(0));
        let (mut hair, mut guided) = (start(corrected), start(guided));
        let (mut most, mut last) = (0.0f64, 0.0f64);
        for k in 1..=100 {
            assert_eq!(step(&mut hair, &pose(k)).quarantined, 0);
            step(&mut guided, &pose(k));
            let offsets = hair.positions().iter().zip(guided.positions());
            last = offsets.map(|(a, &b)| distance(*a, Vector3::from(b).cast())).fold(0.0, f64::max);
            most = most.max(last);
        }
        assert!(most > 0.1, "the comb was to hold hair off");
        assert!(most < HELD_CM && last < LEFT_CM, "{aside}: {most} cm off at most, {last} cm half a second later");
    }
}

#[test]
fn hairs_in_contact_push_their_guides() {
    // A small ball meets hairs between two guides, no guide.
    let run = |params: RuntimeParams| {
        let row = Row::of_three_guides();
        let pose = |k: usize| [at(1.0, -12.0, -1.2 + 0.02 * k as f64)];
        let mut runtime = runtime(row.model(), weightless(params), vec![ball(0.4)], &pose(0));
        let (mut pushed, mut guide_contacts) = (0, 0);
        for k in 1..=80 {
            let report = step(&mut runtime, &pose(k));
            pushed += report.guides_pushed;
            guide_contacts += report.guide_contacts;
        }
        assert_eq!(guide_contacts, 0, "the ball was to miss the guides");
        let guides = runtime.guides_in_head();
        let model = runtime.model();
        let moved = |g: usize| -> f64 {
            let rest = model.rest_of(model.guide_strands[g] as usize);
            f64::from(guides[g * N_PARTICLES + 16][2] - rest[16][2])
        };
        (pushed, moved(0).max(moved(1)))
    };
    let (pushed, moved) = run(RuntimeParams::adaptive());
    let (pushed_without, moved_without) = run(RuntimeParams::no_two_way());
    assert!(pushed > 0 && pushed_without == 0);
    assert!(moved > 0.01, "guides moved by {moved} cm");
    assert!(moved_without.abs() < 1e-6, "guides moved by {moved_without} cm without being pushed");
}

#[test]
fn a_rough_ride_leaves_nothing_that_is_not_a_number() {
    let row = Row::parted();
    for params in
        [RuntimeParams::adaptive(), RuntimeParams::no_two_way(), RuntimeParams::fixed(), RuntimeParams::paper()]
    {
        let mut runtime = runtime(row.model(), params, vec![ball(1.5), rod(0.1, 5.0, 0.5)], &[still(), still()]);
        for k in 0..100 {
            let t = 0.01 * f64::from(k);
            let swing = (12.0 * t).sin();
            // Faster than any hand: solids start inside the hair and cross it at metres a second.
            let poses = [at(8.0 * swing, -9.0, 0.3), at(-6.0 * swing, -6.0, 0.2)];
            let turn = UnitQuaternion::from_euler_angles(0.4 * swing, 2.0 * t, 0.0);
            let head = Isometry3::from_parts(Translation3::new(5.0 * swing, 0.0, 0.0), turn);
            runtime.step(&StepInput { dt: DT, world_from_head: head, world_from_solids: &poses });
            runtime.read();
            assert!(runtime.positions().iter().flatten().all(|x| x.is_finite()));
        }
    }
}

#[test]
fn a_model_that_breaks_an_invariant_is_an_error() {
    let good = Row::of_three_guides().model();
    let refused = |break_it: &dyn Fn(&mut SkinningModel)| {
        let mut model = good.clone();
        break_it(&mut model);
        let built = Runtime::new(model, RuntimeParams::adaptive(), still(), None, vec![], &[]);
        match built.map(|_| ()) {
            Err(Error::Model(why)) => why.to_string(),
            other => panic!("{other:?}"),
        }
    };
    assert!(refused(&|m| m.rest_in_head.truncate(5)).contains("rest_in_head"));
    assert!(refused(&|m| m.rest_in_head[7] = f32::NAN).contains("rest_in_head"));
    assert!(refused(&|m| m.eligible[1] = 99).contains("eligible"));
    assert!(refused(&|m| m.stand_in[8] = u16::MAX).contains("stand_in"));
    assert!(refused(&|m| m.coeff_start[3] = u32::MAX).contains("coeff_start"));
    assert!(refused(&|m| m.n_strands = u32::MAX).contains("rest_in_head"));
    assert!(refused(&|m| m.pairs[0] = [2, 1]).contains("pairs"));
}

#[test]
fn parameters_out_of_range_are_errors() {
    let refused = |break_it: &dyn Fn(&mut RuntimeParams)| {
        let mut params = RuntimeParams::adaptive();
        break_it(&mut params);
        match Runtime::new(Row::parted().model(), params, still(), None, vec![], &[]).map(|_| ()) {
            Err(Error::BadParameter { name, .. }) => name,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(refused(&|p| p.two_way.ridge = f64::NAN), "two_way.ridge");
    assert_eq!(refused(&|p| p.two_way.memory = 1.5), "two_way.memory");
    let no_steps = TwoWaySolve::ConjugateGradients { iterations: 0 };
    assert_eq!(refused(&|p| p.two_way.solve = no_steps), "two_way.solve.iterations");
    assert_eq!(refused(&|p| p.gap_resolution = 0.0), "gap_resolution");
}

#[test]
fn a_missing_pose_is_an_error() {
    let built = Runtime::new(Row::parted().model(), RuntimeParams::adaptive(), still(), None, vec![ball(1.0)], &[]);
    assert!(matches!(built.map(|_| ()), Err(Error::SolidCount { given: 0, expected: 1 })));
}

#[test]
fn a_solid_put_elsewhere_sweeps_nothing_on_its_way_and_hair_leaves_it_at_bounded_speed() {
    /// What a solid that swept the hair between would move it by, cm: many times this.
    const UNMOVED_CM: f64 = 0.01;
    let row = Row::parted();
    let solids = vec![ball(0.8)];
    let params = weightless(RuntimeParams::adaptive());
    let push = params.guides.contact.max_push_speed * DT;
    let (left, right) = ([at(-6.0, -10.0, 0.2)], [at(6.0, -10.0, 0.2)]);
    let mut hair = runtime(row.model(), params, solids, &left);
    for _ in 0..3 {
        step(&mut hair, &left);
    }
    let before = hair.positions().to_vec();
    hair.put_solid(0, &right[0]);
    step(&mut hair, &right);
    let moved = |a: &[[f32; 3]], b: &[[f32; 3]]| {
        a.iter().zip(b).map(|(a, &b)| distance(*a, Vector3::from(b).cast())).fold(0.0, f64::max)
    };
    assert!(moved(&before, hair.positions()) < UNMOVED_CM);
    // Into the middle of the hair: what stands in it comes out by and by, and does come out.
    let middle = [at(1.5, -10.0, 0.3)];
    hair.put_solid(0, &middle[0]);
    let mut last = hair.positions().to_vec();
    let deepest = |hair: &Runtime| {
        let points = hair.positions().iter().map(|&p| distance(p, middle[0].translation.vector));
        points.fold(f64::INFINITY, f64::min) - 0.8
    };
    assert!(deepest(&hair) < -0.5, "the ball was to stand in hair");
    for _ in 0..60 {
        step(&mut hair, &middle);
        // Pushes at one place move what is beside it by up to two and a half times as much.
        let now = moved(&last, hair.positions());
        assert!(now < 2.5 * push + UNMOVED_CM, "{now} cm in a step, pushes are at most {push} each");
        last.copy_from_slice(hair.positions());
    }
    assert!(deepest(&hair) > -0.1, "{} cm deep still", -deepest(&hair));
}
