//! Hair that meets hair through the whole step (MS08 §4 steps 3, 6, 9, §5.2, §5.3): throws, drives, momentum, threads.
#![allow(clippy::unwrap_used, reason = "test code")]

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use strand_sim::interaction::{CollisionWorkspace, LinkSet, StictionParams};
use strand_sim::solve::coupled::CoupledParams;
use strand_sim::{
    Drive, InteractionParams, InteractionWorkspace, Material, RootMotion, Scheme, StepInput, StepParams, StepWorkspace,
    StrandSystem, Substeps,
};

const N: usize = 21;

/// Level strands one above the other at right angles, `gap_cm` apart, 10 cm long, crossing at their middles.
fn crossed(gap_cm: f64) -> Vec<Vector3<f64>> {
    let along = |i: usize| 0.5 * i as f64 - 5.0;
    let lower = (0..N).map(|i| Vector3::new(along(i), 0.0, 0.03));
    lower.chain((0..N).map(|i| Vector3::new(0.21, gap_cm, along(i)))).collect()
}

fn params(scheme: Scheme) -> StepParams {
    StepParams { gravity: Vector3::zeros(), substeps: Substeps::Fixed(1), scheme, ..StepParams::standard() }
}

/// Throws the upper strand of a crossed pair at the lower one: driven as a whole until it is near, from then on by its
/// clamps only. Returns how often
/// they passed unstuck, how often at all, and where the upper one's middle ended over the lower one's.
fn throw(speed_cm_per_s: f64, interaction: &InteractionParams, scheme: Scheme) -> (usize, usize, f64) {
    const DT: f64 = 0.0005;
    let points = crossed(1.37);
    let system = StrandSystem::new(&points, N, Material::straight()).unwrap();
    let mut state = system.rest_state(&Isometry3::identity());
    let (mut links, mut work) = (LinkSet::default(), InteractionWorkspace::default());
    let mut passing = CollisionWorkspace::default();
    let still = Isometry3::identity();
    let down = |y: f64| Isometry3::from(Translation3::new(0.0, -y, 0.0));
    let (mut unstuck, mut all, mut y) = (0, 0, 0.0);
    for _ in 0..(4.0 / speed_cm_per_s / DT).ceil() as usize {
        let next = y + speed_cm_per_s * DT;
        let (before, after) = ([still, down(y)], [still, down(next)]);
        let held = [N - 2, if y < 1.0 { 0 } else { N - 2 }];
        let drives = [0, 1].map(|s: usize| Drive {
            strand: s as u32,
            particles: (held[s], N - 1),
            before: before[s],
            after: after[s],
        });
        let input = StepInput {
            roots: RootMotion::Frames { before: &before, after: &after },
            drives: &drives,
            ..StepInput::still(DT, still)
        };
        let from = system.positions(&state);
        system.step_interacting(&mut state, &mut links, &input, &params(scheme), interaction, &mut work);
        let to = system.positions(&state);
        unstuck += system.count_passes(&from, &to, &links, &mut passing);
        all += system.count_passes(&from, &to, &LinkSet::default(), &mut passing);
        y = next;
    }
    let end = system.positions(&state);
    (unstuck, all, end[N + N / 2].y - end[N / 2].y)
}

#[test]
fn strands_thrown_at_each_other_at_ten_metres_a_second_never_pass_unless_stuck() {
    /// What a middle particle may hang below a lower strand that holds the upper one up elsewhere, cm.
    const SAG_CM: f64 = 0.3;
    for scheme in [Scheme::BackwardEuler, Scheme::TwoSolves] {
        for (name, stiction) in [("dry", StictionParams::dry()), ("none", StictionParams::off())] {
            let meeting = InteractionParams { stiction, ..InteractionParams::dry() };
            assert_eq!(throw(1000.0, &meeting, scheme).0, 0, "{name}, {scheme:?}");
        }
        let loose = InteractionParams { stiction: StictionParams::off(), ..InteractionParams::dry() };
        // Held up by the lower strand, its clamps 2.6 cm below it.
        let (unstuck, all, above) = throw(1000.0, &loose, scheme);
        assert!(unstuck == 0 && all == 0 && above > -SAG_CM, "{scheme:?}: {all} passes, {above} cm above");
        let blind = InteractionParams { collision: None, ..loose };
        let (_, all, above) = throw(1000.0, &blind, scheme);
        assert!(all > 0 && above < -1.0, "{scheme:?}: {all} passes, {above} cm above without collisions");
    }
}

#[test]
fn driven_particles_go_where_they_are_told_however_hair_pushes_them() {
    /// Rounding of poses and of a velocity times a step, cm.
    const ROUND_OFF_CM: f64 = 1e-9;
    let points = crossed(0.02);
    let system = StrandSystem::new(&points, N, Material::straight()).unwrap();
    let mut state = system.rest_state(&Isometry3::identity());
    let (mut links, mut work) = (LinkSet::default(), InteractionWorkspace::default());
    let meeting = InteractionParams::dry();
    let first = N / 2;
    for step in 0..60 {
        let at = |k: f64| {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.004 * k);
            Isometry3::from_parts(Translation3::new(0.0, -0.01 * k, 0.005 * k), turn)
        };
        let (before, after) = (at(f64::from(step)), at(f64::from(step + 1)));
        // The upper strand's middle is driven through where the lower one lies.
        let drives = [Drive { strand: 1, particles: (first - 1, first + 1), before, after }];
        let input = StepInput { drives: &drives, ..StepInput::still(0.002, Isometry3::identity()) };
        let report = system.step_interacting(
            &mut state,
            &mut links,
            &input,
            &params(Scheme::BackwardEuler),
            &meeting,
            &mut work,
        );
        assert!(report.repulsion.touching + report.links.held > 0, "step {step}: the strands were to meet");
        let now = system.positions(&state);
        for i in first - 1..=first + 1 {
            let told = (after * nalgebra::Point3::from(points[N + i])).coords;
            assert!((now[N + i] - told).norm() < ROUND_OFF_CM, "step {step}, particle {i}");
        }
    }
}

/// As [`crossed`], zigzag in their own planes: no three particles are in line, so that no mass is in perturbed ones.
fn crossed_zigzags(gap_cm: f64) -> Vec<Vector3<f64>> {
    let mut points = crossed(gap_cm);
    for (p, x) in points.iter_mut().enumerate() {
        let aside = if p % 2 == 0 { 0.1 } else { -0.1 };
        *x += if p < N { Vector3::z() } else { Vector3::x() } * aside;
    }
    points
}

#[test]
fn what_meeting_changes_of_free_hair_carries_no_momentum() {
    /// Of the momentum exchanged; the coupled solve is told to stop at a thousandth of it.
    const SOLVED: f64 = 1e-9;
    /// Steps so short that clamps do not hear of what happens in the middle, s.
    const DT: f64 = 1e-6;
    let points = crossed_zigzags(0.03);
    let system = StrandSystem::new(&points, N, Material::straight()).unwrap();
    assert_eq!(system.n_straight(), 0);
    let mut inv_mass = Vec::new();
    system.inverse_masses(&mut inv_mass);
    // Forces make the strands approach: up on the lower, down on the upper.
    let forces: Vec<_> = (0..2 * N).map(|p| Vector3::y() * if p < N { 0.5 } else { -0.5 }).collect();
    let input = StepInput { forces: &forces, ..StepInput::still(DT, Isometry3::identity()) };
    let params = params(Scheme::BackwardEuler);
    let velocities = |meeting: Option<&InteractionParams>| {
        let mut state = system.rest_state(&Isometry3::identity());
        let (mut links, mut work) = (LinkSet::default(), InteractionWorkspace::default());
        for _ in 0..3 {
            match meeting {
                Some(m) => _ = system.step_interacting(&mut state, &mut links, &input, &params, m, &mut work),
                None => _ = system.step(&mut state, &input, &params, &mut StepWorkspace::default()),
            }
        }
        let mut velocity = vec![Vector3::zeros(); 2 * N];
        system.read(&state, |s, i, _, v| velocity[s * N + i] = v);
        velocity
    };
    let plain = velocities(None);
    let coupled = CoupledParams { relative_tolerance: 1e-12, max_iterations: 200 };
    for (name, stiction) in [("links", StictionParams::dry()), ("repulsion", StictionParams::off())] {
        let met = velocities(Some(&InteractionParams { stiction, coupled, ..InteractionParams::dry() }));
        let (mut sum, mut exchanged) = (Vector3::zeros(), 0.0);
        for p in (0..2 * N).filter(|&p| inv_mass[p] > 0.0) {
            let impulse = (met[p] - plain[p]) / inv_mass[p];
            sum += impulse;
            exchanged += impulse.norm();
        }
        assert!(exchanged > 0.0, "{name}: nothing was exchanged");
        assert!(sum.norm() < SOLVED * exchanged, "{name}: {} of {exchanged}", sum.norm());
    }
}

#[test]
fn hair_that_meets_hair_gives_the_same_bytes_for_any_number_of_threads() {
    let mut points = Vec::new();
    for s in 0..40 {
        let (sin, cos) = (2.4 * f64::from(s)).sin_cos();
        let root = Vector3::new(cos, 0.0, sin) * (0.04 * f64::from(s).sqrt());
        points.extend((0..N).map(|i| root + Vector3::new(0.01 * sin, -0.5, -0.01 * cos) * i as f64));
    }
    let run = |n_threads: usize, meeting: InteractionParams| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| {
            let system = StrandSystem::new(&points, N, Material::straight()).unwrap();
            let mut state = system.rest_state(&Isometry3::identity());
            let (mut links, mut work) = (LinkSet::default(), InteractionWorkspace::default());
            let at = |k: i32| Isometry3::from(Translation3::new((0.13 * f64::from(k)).sin() * 2.0, 0.0, 0.0));
            let mut met = 0;
            for k in 0..40 {
                let input = StepInput::carried(0.01, at(k), at(k + 1));
                let report = system.step_interacting(
                    &mut state,
                    &mut links,
                    &input,
                    &StepParams::standard(),
                    &meeting,
                    &mut work,
                );
                met += report.repulsion.pushed + report.collision.answered + report.links.made;
            }
            assert!(met > 0, "the strands were to meet");
            let bits: Vec<_> =
                system.positions(&state).iter().flat_map(|p| [p.x, p.y, p.z]).map(f64::to_bits).collect();
            (bits, links)
        })
    };
    let dry = InteractionParams::dry();
    let rubbing = InteractionParams::rubbing_sampled(0.05);
    for meeting in [dry, InteractionParams { stiction: StictionParams::off(), ..dry }, rubbing] {
        let alone = run(1, meeting);
        assert!(alone == run(2, meeting) && alone == run(8, meeting));
    }
}

#[test]
fn a_strand_put_back_from_nonsense_throws_no_other() {
    /// What one step of contact with a strand may change of another, cm; the one put back goes some centimetres.
    const PUSHED_CM: f64 = 0.05;
    const WRONG: usize = 2;
    let strand = |s: usize| (0..N).map(move |i| Vector3::new(0.04 * s as f64, -0.5 * i as f64, 0.0));
    let points: Vec<_> = (0..6).flat_map(strand).collect();
    let system = StrandSystem::new(&points, N, Material::straight()).unwrap();
    for meeting in [InteractionParams::rubbing_sampled(0.05), InteractionParams::rubbing(0.05)] {
        // All are blown to one side; in the last step one goes wrong, and is put back to where it hangs at rest.
        let run = |last: f64| {
            let mut state = system.rest_state(&Isometry3::identity());
            let (mut links, mut work) = (LinkSet::default(), InteractionWorkspace::default());
            let mut put_back = 0;
            for k in 0..20 {
                let mut forces = vec![Vector3::new(0.01, 0.0, 0.0); points.len()];
                if k == 19 {
                    forces[WRONG * N + N / 2].x = last;
                }
                let input = StepInput { forces: &forces, ..StepInput::still(0.01, Isometry3::identity()) };
                let params = StepParams::standard();
                let report = system.step_interacting(&mut state, &mut links, &input, &params, &meeting, &mut work);
                put_back += report.step.quarantined;
            }
            (system.positions(&state), put_back)
        };
        let ((sound, none), (broken, one)) = (run(0.01), run(f64::NAN));
        assert_eq!((none, one), (0, 1));
        let moved = |strand: usize| {
            let of = strand * N..(strand + 1) * N;
            sound[of.clone()].iter().zip(&broken[of]).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
        };
        assert!(moved(WRONG) > 2.0, "it was to be blown far: {} cm", moved(WRONG));
        for other in (0..6).filter(|&s| s != WRONG) {
            assert!(moved(other) < PUSHED_CM, "strand {other} by {} cm, {:?}", moved(other), meeting.sampling);
        }
    }
}
