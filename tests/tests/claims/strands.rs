//! Laws of the strand simulator away from solids (MS08): rest, stillness, energy, length, and independence of company.

use hair_tests::scenes::{
    LENGTH_CM, N_PARTICLES, Tuft, helix, largest_difference, mixed_strands, straight, weightless,
};
use hair_tests::tolerance::{ROUND_OFF_CM, STILL_CM};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use strand_sim::rig::{Perturbed, Topology};
use strand_sim::{Material, StepParams};

fn down() -> Vec<Vector3<f64>> {
    straight(Vector3::zeros(), -Vector3::y())
}

#[test]
fn strands_at_rest_without_gravity_stay_at_rest() {
    let points = mixed_strands(18);
    let mut tuft = Tuft::new(&points, Material::straight(), weightless());
    tuft.rest_for(200);
    assert!(largest_difference(&tuft.positions(), &points) < ROUND_OFF_CM);
}

#[test]
fn a_strand_that_has_settled_hangs_still() {
    let mut tuft = Tuft::new(&down(), Material::straight(), StepParams::standard());
    // Gravity stretches it a little first, and what swings is damped by the air alone, over seconds.
    tuft.rest_for(4000);
    let before = tuft.positions();
    tuft.rest_for(100);
    let moved = largest_difference(&tuft.positions(), &before);
    assert!(moved < STILL_CM, "{moved} cm in a second");
}

#[test]
fn where_the_head_stands_does_not_matter() {
    /// A second of free swinging lets rounding grow, by much less than this (cm).
    const GROWN_ROUND_OFF_CM: f64 = 1e-6;
    let points = mixed_strands(6);
    let moved = Isometry3::from_parts(
        Translation3::new(30.0, -12.0, 7.0),
        UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 1.1),
    );
    let end = |head: Isometry3<f64>| {
        let mut tuft = Tuft::new(&points, Material::straight(), StepParams::standard());
        tuft.state = tuft.system.rest_state(&head);
        tuft.place_head(head);
        tuft.rest_for(100);
        tuft.positions()
    };
    let here: Vec<_> =
        end(Isometry3::identity()).iter().map(|p| moved * nalgebra::Point3::from(*p)).map(|p| p.coords).collect();
    assert!(largest_difference(&end(moved), &here) < GROWN_ROUND_OFF_CM);
}

#[test]
fn hair_carried_to_another_place_takes_its_shape_again() {
    /// What is left after forty seconds of damped swinging, cm.
    const SETTLED_CM: f64 = 0.01;
    let points = mixed_strands(6);
    // Near the critical damping of the slowest swing, that of the helices.
    let material = Material { air_drag_per_s: 0.8, ..Material::straight() };
    let mut tuft = Tuft::new(&points, material, weightless());
    let at = |x: f64| Isometry3::from(Translation3::new(x, 0.0, 0.0));
    for k in 1..=50 {
        tuft.step(at(0.1 * f64::from(k)), &[]);
    }
    let moved: Vec<_> = points.iter().map(|p| p + Vector3::x() * 5.0).collect();
    assert!(largest_difference(&tuft.positions(), &moved) > 1.0, "the hair was to lag behind");
    tuft.rest_for(4000);
    let left = largest_difference(&tuft.positions(), &moved);
    assert!(left < SETTLED_CM, "{left} cm off");
}

#[test]
fn a_strand_does_not_feel_who_shares_its_batch() {
    let points = mixed_strands(18);
    let run = |points: &[Vector3<f64>]| {
        let mut tuft = Tuft::new(points, Material::straight(), StepParams::standard());
        tuft.rest_for(60);
        tuft.positions()
    };
    let together = run(&points);
    for s in [0, 5, 17] {
        let of = s * N_PARTICLES..(s + 1) * N_PARTICLES;
        assert_eq!(run(&points[of.clone()]), together[of], "strand {s}");
    }
}

#[test]
fn a_released_strand_never_gains_energy() {
    /// Share of the energy of falling by the strand's length that the strain limit may lift it by.
    const STRAIN_LIMIT_WORK: f64 = 1e-3;
    // A helix has no perturbed particles: all its mass is where positions are read.
    let points: Vec<_> = helix(Vector3::zeros()).iter().map(|p| Vector3::new(-p.y, p.x, p.z)).collect();
    let material = Material { air_drag_per_s: 0.0, ..Material::straight() };
    let mut tuft = Tuft::new(&points, material, StepParams::standard());
    assert_eq!(tuft.system.n_straight(), 0);
    let spacing = points.windows(2).map(|w| (w[1] - w[0]).norm()).sum::<f64>() / (N_PARTICLES - 1) as f64;
    let mass = Topology::new(&Perturbed::nowhere(N_PARTICLES)).masses(&material, spacing);
    let gravity = tuft.params.gravity;
    let energy = |tuft: &Tuft| {
        let mut sum = 0.0;
        tuft.system.read(&tuft.state, |_, i, x, v| sum += mass[i] * (0.5 * v.norm_squared() - gravity.dot(&x)));
        sum
    };
    // Springs start unstressed and can only hold what has been lost elsewhere, so they need not be counted.
    let start = energy(&tuft);
    let scale = mass.iter().sum::<f64>() * gravity.norm() * LENGTH_CM;
    let mut lowest = start;
    for step in 0..300 {
        tuft.rest_for(1);
        let now = energy(&tuft);
        lowest = lowest.min(now);
        assert!(now <= start + STRAIN_LIMIT_WORK * scale, "step {step}: {now} from {start}");
    }
    assert!(lowest < start - 0.1 * scale, "the strand was to fall");
}

#[test]
fn hair_shaken_at_two_g_keeps_its_length() {
    let points = mixed_strands(18);
    let mut tuft = Tuft::new(&points, Material::straight(), StepParams::standard());
    let omega = std::f64::consts::TAU * 2.0;
    let amplitude = 2.0 * 981.0 / (omega * omega);
    let mut largest: f64 = 0.0;
    for step in 1..=200 {
        let x = amplitude * (1.0 - (omega * 0.01 * f64::from(step)).cos());
        let report = tuft.step(Translation3::new(x, 0.0, 0.0).into(), &[]);
        assert_eq!(report.quarantined, 0);
        let positions = tuft.positions();
        for (now, rest) in positions.chunks(N_PARTICLES).zip(points.chunks(N_PARTICLES)) {
            for (w, r) in now.windows(2).zip(rest.windows(2)) {
                largest = largest.max((w[1] - w[0]).norm() / (r[1] - r[0]).norm() - 1.0);
            }
        }
    }
    assert!(largest <= tuft.params.strain_limit + ROUND_OFF_CM, "{largest}");
}

#[test]
fn a_bent_fibre_bends_alike_at_any_resolution() {
    /// Springs sample a curve: 13 particles may sag this much less or more than 25, as a share.
    const RESOLUTION_SHARE: f64 = 0.15;
    let sag = |n: usize| {
        let length = 8.0;
        let points: Vec<_> = (0..n).map(|i| Vector3::new(length * i as f64 / (n - 1) as f64, 0.0, 0.0)).collect();
        let system =
            strand_sim::StrandSystem::new(&points, n, Material { air_drag_per_s: 30.0, ..Material::straight() })
                .unwrap();
        let mut state = system.rest_state(&Isometry3::identity());
        let mut workspace = strand_sim::StepWorkspace::default();
        let mut params = StepParams::standard();
        // A load that bends little, so that sag is in proportion to 1/EI.
        params.gravity /= 20.0;
        let input = strand_sim::StepInput::still(0.01, Isometry3::identity());
        for _ in 0..1500 {
            system.step(&mut state, &input, &params, &mut workspace);
        }
        -system.positions(&state)[n - 1].y
    };
    let (coarse, fine) = (sag(13), sag(25));
    assert!(fine > 0.01, "the load was to bend the fibre: {fine}");
    // The clamped part is one particle spacing at either resolution, so the coarse fibre is a little shorter.
    assert!((coarse / fine - 1.0).abs() < RESOLUTION_SHARE, "sag {coarse} and {fine}");
}
