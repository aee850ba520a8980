//! Laws of strands meeting solids (AS16 §5.1, §7.1; DESIGN: a particle test alone is not enough).

use collision::{Shape, Solid};
use hair_tests::scenes::{N_PARTICLES, Tuft, ball, dense_samples, rod, sliding, straight};
use hair_tests::tolerance::CONTACT_SLACK_CM;
use nalgebra::{Isometry3, Vector3};
use strand_sim::{Material, StepParams};

/// Particles at the root that move with the scalp and feel no solid.
const FIRST_FREE: usize = 2;

fn hanging() -> Tuft {
    let points = straight(Vector3::zeros(), -Vector3::y());
    Tuft::new(&points, Material::straight(), StepParams::standard())
}

/// Moves a solid straight for `steps` steps; returns the least distance of any sample to it over the way, and the end.
fn push(tuft: &mut Tuft, solid: &Solid, from: Vector3<f64>, to: Vector3<f64>, steps: usize) -> (f64, u64) {
    let (mut least, mut contacts) = (f64::INFINITY, 0);
    for k in 0..steps {
        let at = |k: usize| from.lerp(&to, k as f64 / steps as f64);
        let moving = sliding(solid, at(k), at(k + 1));
        contacts += tuft.step(Isometry3::identity(), &[moving]).contacts;
        for sample in dense_samples(&tuft.positions(), FIRST_FREE) {
            least = least.min(f64::from(moving.distance_at_end(sample)));
        }
    }
    (least, contacts)
}

#[test]
fn a_ball_pushes_a_strand_and_stays_outside_it() {
    let mut tuft = hanging();
    let offset = tuft.params.contact.offset_cm;
    let (least, contacts) =
        push(&mut tuft, &ball(2.0), Vector3::new(-4.0, -14.0, 0.3), Vector3::new(3.0, -14.0, 0.3), 100);
    assert!(contacts > 0);
    assert!(least > offset - CONTACT_SLACK_CM, "came within {least} cm");
}

#[test]
fn a_tooth_between_two_particles_is_still_a_contact() {
    let mut tuft = hanging();
    let height = -12.5;
    let tooth = rod(0.08, 6.0, 0.0);
    let (least, contacts) =
        push(&mut tuft, &tooth, Vector3::new(-1.0, height, 0.0), Vector3::new(3.0, height, 0.0), 100);
    assert!(contacts > 0);
    assert!(least > tuft.params.contact.offset_cm - CONTACT_SLACK_CM, "came within {least} cm");
    // At its height the hair is on the far side: nothing passed through.
    let positions = tuft.positions();
    let crossing = positions.windows(2).find(|w| w[0].y >= height && w[1].y < height).unwrap();
    let at = crossing[0].lerp(&crossing[1], (crossing[0].y - height) / (crossing[0].y - crossing[1].y));
    assert!(at.x > 3.0, "{at}");
}

#[test]
fn a_sliding_face_drags_hair_by_friction_only() {
    let drag = |friction: f32| {
        let mut tuft = hanging();
        let face = Shape::Box { center: Vector3::zeros(), half: Vector3::new(1.0, 4.0, 12.0), rounding: 0.2 };
        let face = Solid::from_shape("face", &face.into(), 0.1, 1.0, friction).unwrap();
        // Pressed in by a centimetre first, then drawn along z.
        push(&mut tuft, &face, Vector3::new(-1.5, -18.0, 0.0), Vector3::new(0.0, -18.0, 0.0), 50);
        push(&mut tuft, &face, Vector3::new(0.0, -18.0, 0.0), Vector3::new(0.0, -18.0, 3.0), 50);
        tuft.positions()[N_PARTICLES - 1].z
    };
    /// Bending couples to twist in a strand with particles on one side, cm.
    const SIDEWAYS_CM: f64 = 0.1;
    let (smooth, rough) = (drag(0.0), drag(0.8));
    assert!(smooth.abs() < SIDEWAYS_CM, "a smooth face dragged the tip by {smooth} cm");
    assert!(rough > 10.0 * SIDEWAYS_CM, "a rough face dragged the tip by {rough} cm only");
}

#[test]
fn a_strand_away_from_all_solids_does_not_feel_them() {
    let solid = ball(2.0);
    let run = |solids: bool| {
        let mut tuft = hanging();
        for k in 0..50 {
            let at = |k: usize| Vector3::new(-9.0 + 0.1 * k as f64, -14.0, 0.0);
            let moving = [sliding(&solid, at(k), at(k + 1))];
            tuft.step(Isometry3::identity(), if solids { &moving } else { &[] });
        }
        tuft.positions()
    };
    assert_eq!(run(true), run(false));
}

#[test]
fn the_strand_that_meets_a_solid_does_not_feel_its_batch_either() {
    let solid = ball(2.0);
    let points: Vec<_> =
        (0..9).flat_map(|s| straight(Vector3::new(0.5 * f64::from(s), 0.0, 0.0), -Vector3::y())).collect();
    let run = |points: &[Vector3<f64>]| {
        let mut tuft = Tuft::new(points, Material::straight(), StepParams::standard());
        for k in 0..60 {
            let at = |k: usize| Vector3::new(-4.0 + 0.1 * k as f64, -14.0, 0.0);
            tuft.step(Isometry3::identity(), &[sliding(&solid, at(k), at(k + 1))]);
        }
        tuft.positions()
    };
    let together = run(&points);
    for s in [0, 3, 8] {
        let of = s * N_PARTICLES..(s + 1) * N_PARTICLES;
        assert_eq!(run(&points[of.clone()]), together[of], "strand {s}");
    }
}
