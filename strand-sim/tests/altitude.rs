//! Laws of altitude springs (MS08 §3.1 and Appendix) on random, flat, collinear and inverted tetrahedra.

use nalgebra::Vector3;
use strand_sim::altitude::{Altitude, AltitudeRest, CANDIDATES, FLOOR, PREFERENCE, altitude, altitude_lanes};
use strand_sim::lanes::{LANES, Lane3, ZERO};
use strand_sim::rig::perturb::rig_particles;
use strand_sim::rig::{Perturbed, Topology};

type Corners = [Vector3<f64>; 4];

/// Relative round-off of a handful of products of numbers near one.
const ROUND_OFF: f64 = 1e-12;
/// Of weights from face areas when the tetrahedron is thin: the gradients cancel where the tests let them be thin.
const THIN_ROUND_OFF: f64 = 1e-9;
/// Central differences with a step of 1e-5 of a length near one: truncation 1e-10 times third derivatives near 1e2.
const DIFFERENCE_ERROR: f64 = 1e-6;
const DIFFERENCE_STEP: f64 = 1e-5;

struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64) / ((1_u64 << 53) as f64) - 0.5
    }

    fn point(&mut self) -> Vector3<f64> {
        Vector3::new(self.unit(), self.unit(), self.unit())
    }

    fn corners(&mut self) -> Corners {
        std::array::from_fn(|_| self.point())
    }

    /// Flattened to `thickness` along a random axis: any shape from plump to nearly planar.
    fn flattened(&mut self, thickness: f64) -> Corners {
        let axis = self.point().normalize();
        self.corners().map(|p| p - axis * (p.dot(&axis) * (1.0 - thickness)))
    }
}

fn six_volumes(x: &Corners) -> f64 {
    (x[1] - x[0]).dot(&(x[2] - x[0]).cross(&(x[3] - x[0])))
}

/// |u×v| of every candidate, written out from the paper.
fn areas(x: &Corners) -> [f64; CANDIDATES] {
    let face = |a: usize, b: usize, c: usize| (x[b] - x[a]).cross(&(x[c] - x[a])).norm();
    let pair = |a: usize, b: usize, c: usize, d: usize| (x[b] - x[a]).cross(&(x[d] - x[c])).norm();
    [face(1, 2, 3), face(0, 2, 3), face(0, 1, 3), face(0, 1, 2), pair(0, 1, 2, 3), pair(0, 2, 1, 3), pair(0, 3, 1, 2)]
}

fn forces(spring: &Altitude, stiffness: f64) -> Corners {
    let pull = stiffness * spring.per_length * (spring.length - spring.rest_length);
    spring.weight.map(|w| spring.direction * (-pull * w))
}

#[test]
fn lengths_are_six_volumes_over_the_largest_area_that_of_rest_preferred() {
    let mut random = Random(1);
    for _ in 0..2000 {
        let x = random.corners();
        let rest = AltitudeRest::new(&random.corners());
        let spring = altitude(&x, &rest).expect("four scattered points");
        let scores = areas(&x).map(|a| a * a);
        let score = |i: usize| if i == rest.preferred { PREFERENCE * scores[i] } else { scores[i] };
        let largest = (0..CANDIDATES).map(score).fold(0.0, f64::max);
        assert!((score(spring.candidate) / largest - 1.0).abs() < ROUND_OFF);
        assert!((spring.length - six_volumes(&x) / areas(&x)[spring.candidate]).abs() < ROUND_OFF);
        assert!((spring.direction.norm() - 1.0).abs() < ROUND_OFF);
    }
}

#[test]
fn length_is_the_weighted_sum_of_the_corners_along_the_direction() {
    let mut random = Random(2);
    for thickness in [1.0, 0.1, 1e-3, 0.0] {
        for _ in 0..500 {
            let x = random.flattened(thickness);
            let spring = altitude(&x, &AltitudeRest::new(&x)).expect("four points with area");
            let nodes: Vector3<f64> = (0..4).map(|p| x[p] * spring.weight[p]).sum();
            assert!((nodes.dot(&spring.direction) - spring.length).abs() < ROUND_OFF);
            // The virtual nodes face each other: nothing of their distance is sideways.
            assert!((nodes - spring.direction * spring.length).norm() < THIN_ROUND_OFF);
        }
    }
}

#[test]
fn the_chosen_virtual_nodes_lie_inside_their_face_or_edges_but_for_the_preference() {
    // MS08, Appendix: the least length has no negative barycentric weight; preferring edges costs this much.
    let outside = PREFERENCE.sqrt() - 1.0 + THIN_ROUND_OFF;
    let mut random = Random(3);
    let mut seen = [0; CANDIDATES];
    for thickness in [1.0, 0.1, 1e-3, 0.0] {
        for _ in 0..2000 {
            let x = random.flattened(thickness);
            let spring = altitude(&x, &AltitudeRest::new(&x)).expect("four points with area");
            let positive: &[usize] = [&[0_usize][..], &[1], &[2], &[3], &[2, 3], &[1, 3], &[1, 2]][spring.candidate];
            for p in 0..4 {
                let share = if positive.contains(&p) { spring.weight[p] } else { -spring.weight[p] };
                assert!((-outside..=1.0 + outside).contains(&share), "weight {share}");
            }
            seen[spring.candidate] += 1;
        }
    }
    assert!(seen.iter().all(|&n| n > 0), "candidates chosen {seen:?}");
}

#[test]
fn a_spring_exerts_no_force_and_no_torque_on_the_whole() {
    let mut random = Random(4);
    for thickness in [1.0, 0.05, 0.0] {
        for _ in 0..1000 {
            let x = random.flattened(thickness);
            let spring = altitude(&x, &AltitudeRest::new(&random.corners())).expect("four points with area");
            let f = forces(&spring, 7.0);
            let largest = f.iter().map(|f| f.norm()).fold(0.0, f64::max);
            let total: Vector3<f64> = f.iter().sum();
            let torque: Vector3<f64> = (0..4).map(|p| x[p].cross(&f[p])).sum();
            assert!(total.norm() <= ROUND_OFF * largest);
            assert!(torque.norm() <= THIN_ROUND_OFF * largest);
        }
    }
}

#[test]
fn force_is_the_gradient_of_the_energy() {
    let mut random = Random(5);
    let energy = |x: &Corners, rest: &AltitudeRest| {
        let spring = altitude(x, rest).expect("four scattered points");
        (0.5 * spring.per_length * (spring.length - spring.rest_length).powi(2), spring.candidate)
    };
    let mut checked = 0;
    for _ in 0..500 {
        let (x, rest) = (random.corners(), AltitudeRest::new(&random.corners()));
        let largest = areas(&x).into_iter().fold(0.0, f64::max);
        if largest < 0.2 {
            continue;
        }
        let spring = altitude(&x, &rest).expect("four scattered points");
        let f = forces(&spring, 1.0);
        for p in 0..4 {
            for k in 0..3 {
                let moved = |by: f64| {
                    let mut y = x;
                    y[p][k] += by;
                    energy(&y, &rest)
                };
                let (plus, minus) = (moved(DIFFERENCE_STEP), moved(-DIFFERENCE_STEP));
                if plus.1 != spring.candidate || minus.1 != spring.candidate {
                    continue;
                }
                let slope = (plus.0 - minus.0) / (2.0 * DIFFERENCE_STEP);
                assert!((slope + f[p][k]).abs() < DIFFERENCE_ERROR * (1.0 + f[p][k].abs()) / spring.per_length.recip());
                checked += 1;
            }
        }
    }
    assert!(checked > 1000);
}

#[test]
fn a_tetrahedron_at_rest_carries_no_stress_whatever_its_shape() {
    let mut random = Random(6);
    for thickness in [1.0, 0.1, 1e-4, 0.0] {
        for _ in 0..500 {
            let x = random.flattened(thickness);
            let rest = AltitudeRest::new(&x);
            let spring = altitude(&x, &rest).expect("four points with area");
            assert!((spring.length - spring.rest_length).abs() * spring.per_length < ROUND_OFF);
        }
    }
}

#[test]
fn an_inverted_tetrahedron_is_pulled_back_through_its_plane() {
    let mut random = Random(7);
    for _ in 0..1000 {
        let x = random.corners();
        let rest = AltitudeRest::new(&x);
        let inverted = x.map(|p| Vector3::new(p.x, p.y, -p.z));
        let spring = altitude(&inverted, &rest).expect("four scattered points");
        let f = forces(&spring, 1.0);
        // A small step along the force must change the volume towards its rest sign, not away from it.
        let longest = f.iter().map(|f| f.norm()).fold(0.0, f64::max);
        let moved: Corners = std::array::from_fn(|p| inverted[p] + f[p] * (1e-6 / longest));
        let change = six_volumes(&moved) - six_volumes(&inverted);
        assert!(change * six_volumes(&x) > 0.0);
    }
}

#[test]
fn a_flat_rest_shape_has_a_bounded_spring_that_holds_it_flat() {
    let flat = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]].map(Vector3::from);
    let rest = AltitudeRest::new(&flat);
    assert!(rest.length.iter().all(|l| l.abs() < ROUND_OFF));
    let size = ((4.0 + 2.0 * 2.0) / 6.0_f64).sqrt();
    assert!((rest.floor - FLOOR * size).abs() < ROUND_OFF);
    for lift in [0.1, -0.1] {
        let mut bent = flat;
        bent[2].z = lift;
        let spring = altitude(&bent, &rest).expect("a square has area");
        let f = forces(&spring, 1.0);
        assert!(f[2].z * lift < 0.0);
        assert!((spring.per_length * rest.floor - 1.0).abs() < ROUND_OFF);
    }
}

#[test]
fn collinear_corners_are_parted_square_to_their_line_and_collapsed_ones_left_alone() {
    let rest = AltitudeRest::new(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Vector3::from));
    let axis = Vector3::new(1.0, 2.0, -0.5);
    for order in [[0.0, 1.0, 2.0, 3.0], [2.0, 0.0, 3.5, 1.0], [-1.0, 5.0, 0.5, 2.0]] {
        let line = order.map(|t| axis * t);
        let spring = altitude(&line, &rest).expect("four places on a line");
        assert!(spring.candidate >= 4 && spring.length == 0.0);
        assert!(spring.direction.dot(&axis).abs() < ROUND_OFF);
        assert!(spring.weight.iter().all(|w| (-1.0..=1.0).contains(w)));
        let nodes: Vector3<f64> = (0..4).map(|p| line[p] * spring.weight[p]).sum();
        assert!(nodes.norm() < ROUND_OFF * 10.0);
        let f = forces(&spring, 1.0);
        let moved: Corners = std::array::from_fn(|p| line[p] + f[p] * 1e-2);
        assert!(areas(&moved).into_iter().fold(0.0, f64::max) > 1e-3);
    }
    let pairs = [0.0, 0.0, 1.0, 1.0].map(|t| axis * t);
    assert_eq!(altitude(&pairs, &rest), None);
    assert_eq!(altitude(&[axis; 4], &rest), None);
    assert_eq!(altitude(&[axis, axis * f64::NAN, axis, -axis], &rest), None);
}

fn lanes_of(x: &[Corners; LANES]) -> [Lane3; 4] {
    std::array::from_fn(|p| {
        let mut out = [ZERO; 3];
        for l in 0..LANES {
            (out[0][l], out[1][l], out[2][l]) = (x[l][p].x, x[l][p].y, x[l][p].z);
        }
        out
    })
}

#[test]
fn lanes_agree_with_the_plain_form_on_every_kind_of_tetrahedron() {
    let mut random = Random(8);
    let nan = Vector3::new(f64::NAN, 0.0, 0.0);
    for round in 0..3000 {
        let mut x: [Corners; LANES] = std::array::from_fn(|l| random.flattened([1.0, 0.3, 1e-2, -1.0][l % 4]));
        if round % 3 == 0 {
            let axis = random.point();
            x[round % LANES] = std::array::from_fn(|_| axis * random.unit());
            x[(round + 3) % LANES] = [axis, random.point(), axis, axis];
            x[(round + 5) % LANES][round % 4] = nan;
        }
        let rests: [AltitudeRest; LANES] = std::array::from_fn(|_| AltitudeRest::new(&random.corners()));
        let mut rest = rests[0].splat();
        for l in 0..LANES {
            rest.set(l, &rests[l]);
        }
        let lanes = lanes_of(&x);
        let fast = altitude_lanes([&lanes[0], &lanes[1], &lanes[2], &lanes[3]], &rest);
        for l in 0..LANES {
            let Some(plain) = altitude(&x[l], &rests[l]) else {
                assert_eq!(fast.per_length[l], 0.0);
                assert!(fast.weight.iter().all(|w| w[l] == 0.0) && fast.length[l] == 0.0);
                continue;
            };
            assert_eq!(fast.rest_length[l], plain.rest_length, "another candidate was chosen");
            assert!((fast.length[l] - plain.length).abs() < THIN_ROUND_OFF);
            assert!((fast.per_length[l] / plain.per_length - 1.0).abs() < ROUND_OFF);
            for p in 0..4 {
                assert!((fast.weight[p][l] - plain.weight[p]).abs() < THIN_ROUND_OFF);
            }
            for k in 0..3 {
                assert!((fast.direction[k][l] - plain.direction[k]).abs() < THIN_ROUND_OFF);
            }
        }
    }
}

#[test]
fn a_lane_does_not_feel_its_neighbours() {
    let mut random = Random(9);
    for _ in 0..200 {
        let kept = random.corners();
        let rest = AltitudeRest::new(&random.corners()).splat();
        let mut seen = None;
        for neighbours in 0..3 {
            let axis = random.point();
            let mut x: [Corners; LANES] = std::array::from_fn(|l| match neighbours {
                0 => random.corners(),
                1 => std::array::from_fn(|p| axis * (p as f64 + l as f64)),
                _ => [axis; 4],
            });
            x[5] = kept;
            let lanes = lanes_of(&x);
            let out = altitude_lanes([&lanes[0], &lanes[1], &lanes[2], &lanes[3]], &rest);
            let mine =
                (out.length[5].to_bits(), out.weight.map(|w| w[5].to_bits()), out.direction.map(|d| d[5].to_bits()));
            assert_eq!(*seen.get_or_insert(mine), mine);
        }
    }
}

#[test]
fn the_straight_rig_keeps_its_springs_when_shaken_a_little() {
    // A point over a face and a pair of edges tie at rest: the preference decides, not round-off.
    let points: Vec<_> = (0..25).map(|i| Vector3::new(0.0, -f64::from(i), 0.0)).collect();
    let rig = rig_particles(&Topology::new(&Perturbed::everywhere(points.len())), &points);
    let mut random = Random(10);
    for _ in 0..100 {
        let shaken: Vec<_> = rig.iter().map(|p| p + random.point() * 0.01).collect();
        for (at_rest, now) in rig.windows(4).zip(shaken.windows(4)) {
            let rest = AltitudeRest::new(&[at_rest[0], at_rest[1], at_rest[2], at_rest[3]]);
            let spring = altitude(&[now[0], now[1], now[2], now[3]], &rest).expect("nearly at rest");
            assert_eq!(spring.candidate, 6);
        }
    }
}

#[test]
fn every_four_neighbours_of_both_rigs_carry_a_spring() {
    // A gently twisted curl is nearly flat over four particles, which is where the floor matters.
    let straight: Vec<_> = (0..25).map(|i| Vector3::new(0.0, -f64::from(i), 0.0)).collect();
    let curl = |pitch: f64| -> Vec<Vector3<f64>> {
        (0..25)
            .map(|i| {
                let angle = 0.6 * f64::from(i);
                Vector3::new(angle.cos(), -pitch * f64::from(i), angle.sin())
            })
            .collect()
    };
    for (perturbed, points) in [
        (Perturbed::everywhere(25), straight),
        (Perturbed::nowhere(25), curl(0.3)),
        (Perturbed::nowhere(25), curl(1e-3)),
        (Perturbed::nowhere(25), curl(0.0)),
    ] {
        let rig = rig_particles(&Topology::new(&perturbed), &points);
        for w in rig.windows(4) {
            let x: Corners = [w[0], w[1], w[2], w[3]];
            let rest = AltitudeRest::new(&x);
            let spring = altitude(&x, &rest).expect("no four neighbours are collinear");
            assert!((spring.length - spring.rest_length).abs() * spring.per_length < ROUND_OFF);
            assert!(spring.per_length <= 1.0 / rest.floor);
        }
    }
}
