//! Hair that something holds off its guides, kept out of the head.

use super::{Moving, Surroundings, put_right};
use crate::offset::N_FIXED;
use crate::planes::{dot, less};
use crate::response::Response;
use crate::solid_in_head::particle;
use nalgebra::Vector3;

/// Offsets longer than this are kept out of the head, cm: what lies on its guides lies outside it.
const HELD_CM: f32 = 0.05;

/// Moves particles that are held off their place out of the head.
pub(super) fn keep_out_of_head(around: &Surroundings, response: &Response, work: &mut Moving) {
    let Some(head) = around.head else { return };
    let pad = around.pad;
    let gap_kept = around.params.guides.contact.offset_cm as f32;
    // How far beyond the distance kept the strand surely is, where it was sampled last: nothing is asked of the particles within.
    let (mut sure, mut before) = (0.0, [0.0; 3]);
    for i in N_FIXED..around.n {
        let (p, s) = (particle(&work.x, pad, i), particle(&work.now, pad, i));
        let along = less(p, before);
        before = p;
        if sure > 0.0 {
            sure -= dot(along, along).sqrt();
        }
        let d = less(p, s);
        if sure > 0.0 || dot(d, d) < HELD_CM * HELD_CM {
            continue;
        }
        let distance = head.sdf.distance(Vector3::from(p));
        sure = head.sdf.surely(distance) - gap_kept;
        if distance >= gap_kept {
            continue;
        }
        let (distance, normal) = head.sdf.outward_normal(Vector3::from(p));
        // Hair that its guides have nearer than that is not moved out farther than they have it.
        let kept = gap_kept.min(head.sdf.distance(Vector3::from(s)));
        if distance < kept {
            let by = normal * (kept - distance);
            put_right(response, (i - 1, 1.0), by.into(), work);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::RuntimeParams;
    use crate::response::Elasticity;
    use crate::test_model::Noise;
    use collision::{Shape, ShapeUnion, Solid};

    const PAD: usize = 32;
    const N: usize = 25;

    /// As [`keep_out_of_head`], asking the head of every particle.
    fn asking_of_all(around: &Surroundings, response: &Response, work: &mut Moving) -> usize {
        let head = &around.head.unwrap().sdf;
        let kept = around.params.guides.contact.offset_cm as f32;
        let mut pushed = 0;
        for i in N_FIXED..N {
            let (p, s) = (particle(&work.x, PAD, i), particle(&work.now, PAD, i));
            let (distance, normal) = head.outward_normal(Vector3::from(p));
            let kept = kept.min(head.distance(Vector3::from(s)));
            if dot(less(p, s), less(p, s)) >= HELD_CM * HELD_CM && distance < kept {
                put_right(response, (i - 1, 1.0), (normal * (kept - distance)).into(), work);
                pushed += 1;
            }
        }
        pushed
    }

    #[test]
    fn asking_the_head_of_few_particles_moves_hair_as_asking_it_of_all() {
        const RADIUS_CM: f32 = 8.0;
        let ball = Shape::Sphere { center: Vector3::zeros(), radius: RADIUS_CM };
        let head =
            Solid::from_shape("head", &ShapeUnion { shapes: vec![ball], smoothing: 0.0 }, 0.2, 4.0, 0.3).unwrap();
        let params = RuntimeParams::adaptive();
        let (solids, params, head, responses) = (&[][..], &params, Some(&head), &[][..]);
        let (dt, time, step, steps, length_cm) = (0.01, 1.0, 7, 1, 24.0);
        let around = Surroundings { dt, time, step, steps, solids, head, params, responses, length_cm, pad: PAD, n: N };
        let material = strand_sim::Material::straight();
        let of = Elasticity { spacing_cm: 1.0, material: &material, gravity_cm_per_s2: 981.0, return_rate: 5.0 };
        let response = Response::new(N, PAD, of, 0.01);
        let mut noise = Noise::new(11);
        let mut pushed = 0;
        for _ in 0..200 {
            // Down past the ball, here in it, there a hand's breadth off, on a skinned strand just outside.
            let (out, wave, turn) = (RADIUS_CM + 0.2 + 4.0 * noise.next(), 6.0 * noise.next(), noise.next());
            let (mut skin, mut x) = (vec![0.0; 3 * PAD], vec![0.0; 3 * PAD]);
            for i in 0..PAD {
                let along = i.min(N - 1) as f32;
                (skin[i], skin[PAD + i]) = (out, 8.0 - along);
                let off = if i < N_FIXED { 0.0 } else { wave * (0.4 * along + 6.0 * turn).sin() };
                (x[i], x[PAD + i]) = (out + off, 8.0 - along);
            }
            let work = || {
                let mut work = Moving::default();
                (work.now, work.x, work.offset) = (skin.clone(), x.clone(), vec![0.0; 3 * PAD]);
                work
            };
            let (mut few, mut all) = (work(), work());
            keep_out_of_head(&around, &response, &mut few);
            pushed += asking_of_all(&around, &response, &mut all);
            assert_eq!((few.x, few.offset), (all.x, all.offset));
        }
        assert!(pushed > 200, "{pushed}: hardly tried");
    }
}
