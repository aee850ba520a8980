//! A combed head of hair, of any strand count, from a seed.
//!
//! Roots are spread over the scalp with a least distance that shrinks as they become many, so that any count covers it
//! evenly and every prefix of a groom is an even, sparser groom. A strand leaves along the normal, turns into a smooth field of combing directions (from the
//! forehead back and down) and then hangs, kept at a distance from the head that grows along the strand: hair that has
//! come far lies on top of hair rooted there. Invariant: the root is on the surface and every other particle at least
//! [`LEAST_DISTANCE_CM`] outside.

use std::collections::HashMap;

use collision::{SignedDistanceField, Solid};
use io_formats::groom::UniformGroom;
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use crate::error::Error;
use crate::shapes::CRANIUM_CENTER;

/// Shape of the strands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// Straight, with slight irregularities.
    Straight,
    /// With waves whose phase runs smoothly over the scalp.
    Wavy,
    /// In curls about the combed direction, phases as those of waves.
    Curly,
}

/// What to grow, and on what.
#[derive(Debug, Clone, Copy)]
pub struct GroomParams<'a> {
    /// Shape of the strands.
    pub style: Style,
    /// Number of strands.
    pub strands: usize,
    /// Particles of each strand, root included; at least 2.
    pub particles: usize,
    /// Mean strand length, cm; strands differ from it smoothly by up to a tenth.
    pub length_cm: f32,
    /// Seed of roots and irregularities.
    pub seed: u64,
    /// The head, as built by [`crate::shapes::head`].
    pub head: &'a Solid,
}

/// Every particle but the root keeps at least this distance from the head, cm.
pub const LEAST_DISTANCE_CM: f32 = 0.1;

/// Distance kept while a strand is drawn; resampling may cut a little off it.
const DRAWN_DISTANCE_CM: f32 = 0.2;
/// Step along a strand while it is drawn, cm.
const STEP_CM: f32 = 0.2;
/// Arc length over which a strand's direction follows the field, cm: stiffness, as it were.
const BEND_CM: f32 = 0.55;
const WAVE_AMPLITUDE_CM: f32 = 0.4;
const CURL_RADIUS_CM: f32 = 0.75;
const WAVE_LENGTH_CM: f32 = 4.0;

/// Grows a groom.
///
/// # Errors
/// Fewer than one strand or two particles, a length under 1 cm, a head without a scalp.
pub fn generate(params: &GroomParams) -> Result<UniformGroom, Error> {
    let least = |name, value: f64, least: f64| {
        if value.is_finite() && value >= least { Ok(()) } else { Err(Error::BadParameter { name, value, least }) }
    };
    least("strands", params.strands as f64, 1.0)?;
    least("particles", params.particles as f64, 2.0)?;
    least("length_cm", f64::from(params.length_cm), 1.0)?;

    let roots = roots(params)?;
    let mut points = vec![[0.0; 3]; params.strands * params.particles];
    points
        .par_chunks_mut(params.particles)
        .zip(&roots)
        .enumerate()
        .for_each(|(n, (out, &root))| grow(params, n as u64, root, out));
    Ok(UniformGroom { n_strands: params.strands, n_particles: params.particles, points })
}

/// Grows straight hair all over a ball about the origin: up to a few per cent longer or shorter, and leaning a little, as on
/// a head. Every prefix is an even, sparser groom.
///
/// # Errors
/// Fewer than one strand or two particles, lengths under 1 cm, a style that is not straight.
pub fn on_ball(params: &GroomParams, radius_cm: f32) -> Result<UniformGroom, Error> {
    /// Steps of an additive recurrence that spreads points evenly over a square, whatever their number.
    const STEPS: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];
    let least = |name, value: f64, least: f64| {
        if value.is_finite() && value >= least { Ok(()) } else { Err(Error::BadParameter { name, value, least }) }
    };
    least("strands", params.strands as f64, 1.0)?;
    least("particles", params.particles as f64, 2.0)?;
    least("length_cm", f64::from(params.length_cm), 1.0)?;
    least("radius_cm", f64::from(radius_cm), 1.0)?;
    let mut points = vec![[0.0; 3]; params.strands * params.particles];
    points.par_chunks_mut(params.particles).enumerate().for_each(|(k, strand)| {
        let [u, v] = STEPS.map(|step| (0.5 + step * (k + 1) as f64).fract() as f32);
        let height = 2.0 * u - 1.0;
        let across = (1.0 - height * height).max(0.0).sqrt();
        let (sin, cos) = (2.0 * std::f32::consts::PI * v).sin_cos();
        let out = Vector3::new(across * sin, height, across * cos);
        let root = out * radius_cm;
        let mut random = Pcg64Mcg::seed_from_u64(params.seed ^ (k as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let lean = Vector3::from(random.random::<[f32; 3]>()).add_scalar(-0.5) * 0.1;
        let length = params.length_cm * (1.0 + 0.05 * noise(root * 0.15, params.seed ^ 1));
        let last = (params.particles - 1) as f32;
        let mut p = root;
        for (i, point) in strand.iter_mut().enumerate() {
            *point = p.into();
            // The first centimetres stand up as hair does; then it leans and sinks a little.
            let along = i as f32 / last;
            let direction = out + (lean - Vector3::y() * 0.5) * along;
            p += direction.try_normalize(1e-3).unwrap_or(out) * (length / last);
        }
    });
    Ok(UniformGroom { n_strands: params.strands, n_particles: params.particles, points })
}

/// Evenly spread points on the scalp: random points, of which those too near an earlier one are dropped. The distance
/// asked for shrinks as roots become many, so that every prefix is about as even as the whole.
fn roots(params: &GroomParams) -> Result<Vec<Vector3<f32>>, Error> {
    /// Largest surface per direction on a head of about 9 cm, cm^2.
    const MOST_SURFACE: f32 = 120.0;
    /// Generous guess of the scalp, cm^2, for the distance only: with the share below, about one point in three is kept.
    const SCALP_CM2: f32 = 650.0;
    /// Share of the mean spacing asked for. Random placement jams at 0.835, and slows a hundredfold well before.
    const EVENNESS: f32 = 0.42;
    /// About one direction in ten makes a root; a hundred times that without success means there is no scalp.
    const TRIES_PER_ROOT: usize = 1_000;

    let sdf = &params.head.sdf;
    let center = Vector3::from(CRANIUM_CENTER);
    let mut random = Pcg64Mcg::seed_from_u64(params.seed);
    let mut roots: Vec<Vector3<f32>> = Vec::with_capacity(params.strands);
    let mut near = Buckets::default();
    for _ in 0..params.strands.saturating_mul(TRIES_PER_ROOT).max(10_000) {
        let u: [f32; 3] = random.random();
        let height = 2.0 * u[0] - 1.0;
        let across = (1.0 - height * height).max(0.0).sqrt();
        let (sin, cos) = (2.0 * std::f32::consts::PI * u[1]).sin_cos();
        let direction = Vector3::new(across * sin, height, across * cos);
        if !is_scalp(&direction) {
            continue;
        }
        let Some(root) = surface_along(sdf, &direction) else { continue };
        // Thinned out where a direction covers less surface.
        let (_, normal) = sdf.outward_normal(root);
        let surface = (root - center).norm_squared() / normal.dot(&direction).max(0.2);
        if u[2] * MOST_SURFACE > surface {
            continue;
        }
        let apart = EVENNESS * (SCALP_CM2 / (roots.len() + 1) as f32).sqrt();
        if near.any_within(apart, &root, &roots) {
            continue;
        }
        roots.push(root);
        near.add(&roots, apart);
        if roots.len() == params.strands {
            return Ok(roots);
        }
    }
    Err(Error::NoScalp { name: params.head.name.clone() })
}

/// Roots by cubes of space, for asking who is near. Only looked up, never iterated, so no order leaks from the map.
#[derive(Default)]
struct Buckets {
    edge: f32,
    map: HashMap<[i32; 3], Vec<u32>>,
}

impl Buckets {
    fn cube(&self, p: &Vector3<f32>) -> [i32; 3] {
        [0, 1, 2].map(|k: usize| (p[k] / self.edge).floor() as i32)
    }

    /// Adds the last of `roots`; sorts all into smaller cubes once the distance asked for is half of what it was.
    fn add(&mut self, roots: &[Vector3<f32>], apart: f32) {
        let first = if self.map.is_empty() || apart < 0.5 * self.edge {
            self.edge = apart;
            self.map.clear();
            0
        } else {
            roots.len() - 1
        };
        for n in first..roots.len() {
            self.map.entry(self.cube(&roots[n])).or_default().push(n as u32);
        }
    }

    fn any_within(&self, apart: f32, p: &Vector3<f32>, roots: &[Vector3<f32>]) -> bool {
        if self.map.is_empty() {
            return false;
        }
        let [x, y, z] = self.cube(p);
        (0..27).any(|n| {
            let cube = [x + n % 3 - 1, y + n / 3 % 3 - 1, z + n / 9 - 1];
            let there = self.map.get(&cube).map_or(&[][..], Vec::as_slice);
            there.iter().any(|&r| (roots[r as usize] - p).norm() < apart)
        })
    }
}

/// Whether hair grows in a direction from the cranium's centre: above a line that runs over the forehead, down the
/// temples, around the ears and along the nape.
fn is_scalp(direction: &Vector3<f32>) -> bool {
    let elevation = direction.y.clamp(-1.0, 1.0).asin().to_degrees();
    let turn = direction.x.abs().atan2(direction.z).to_degrees();
    let hairline = 36.0
        - 22.0 * smooth_step(22.0, 58.0, turn)
        - 8.0 * smooth_step(60.0, 85.0, turn)
        - 38.0 * smooth_step(88.0, 125.0, turn);
    elevation > hairline
}

/// Where a ray from the cranium's centre leaves the head, bisected between inside and outside.
fn surface_along(sdf: &SignedDistanceField, direction: &Vector3<f32>) -> Option<Vector3<f32>> {
    const REACH_CM: f32 = 14.0;
    const HALVINGS: usize = 24;
    let at = |t: f32| Vector3::from(CRANIUM_CENTER) + direction * t;
    let (mut inside, mut outside) = (0.0, REACH_CM);
    if sdf.distance(at(inside)) >= 0.0 || sdf.distance(at(outside)) <= 0.0 {
        return None;
    }
    for _ in 0..HALVINGS {
        let t = 0.5 * (inside + outside);
        if sdf.distance(at(t)) < 0.0 { inside = t } else { outside = t }
    }
    Some(at(outside))
}

/// Draws one strand finely and resamples it to the particles of `out`.
fn grow(params: &GroomParams, strand: u64, root: Vector3<f32>, out: &mut [[f32; 3]]) {
    let sdf = &params.head.sdf;
    let mut random = Pcg64Mcg::seed_from_u64(params.seed ^ (strand + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let length = params.length_cm * (1.0 + 0.1 * noise(root * 0.15, params.seed ^ 1));
    let layer: f32 = random.random();
    let lean = Vector3::from(random.random::<[f32; 3]>()).add_scalar(-0.5) * 0.07;
    // Chords are shorter than the drawn arc: in the bend at the root, and along waves.
    let drawn = if params.style == Style::Straight { 1.08 } else { 1.25 } * length + 2.0 * STEP_CM;

    let (_, normal) = sdf.outward_normal(root);
    let mut axis = vec![root];
    let mut direction = normal;
    let mut p = root;
    let steps = (drawn / STEP_CM).ceil() as usize;
    for n in 1..=steps {
        let s = n as f32 * STEP_CM;
        let (d, normal) = sdf.outward_normal(p);
        let mut wanted = combed(p, root) + lean;
        for (k, w) in wanted.iter_mut().enumerate() {
            *w += 0.06 * noise(p * 0.2, params.seed ^ (2 + k as u64));
        }
        let kept = (0.25 + 0.45 * layer + 0.04 * s.min(20.0)) * smooth_step(0.0, 2.5, s);
        let near = 1.0 - smooth_step(kept, kept + 0.6, d);
        wanted -= normal * (wanted.dot(&normal).min(0.0) * near);
        wanted += normal * (1.2 * (kept - d)).clamp(-0.25, 1.0);
        let wanted = wanted.try_normalize(1e-3).unwrap_or(direction);
        // The first millimetres stand up; a strand then gives way to the comb within a bend length.
        let follow = (STEP_CM / BEND_CM) * smooth_step(0.0, 0.6, s);
        direction = direction.lerp(&wanted, follow).try_normalize(1e-3).unwrap_or(wanted);
        p += direction * STEP_CM;
        p = pushed_out(sdf, p);
        axis.push(p);
    }
    // Size of the wave sideways and away from the head.
    let displaced = match params.style {
        Style::Straight => None,
        Style::Wavy => Some([WAVE_AMPLITUDE_CM, 0.5 * WAVE_AMPLITUDE_CM]),
        Style::Curly => Some([CURL_RADIUS_CM; 2]),
    };
    if let Some(amplitudes) = displaced {
        let phase = wave_phase(root, params.seed) + 0.5 * random.random::<f32>();
        wave(sdf, &mut axis, phase, amplitudes);
    }
    resample(&axis, length, out);
    for point in out.iter_mut().skip(1) {
        let p = Vector3::from(*point);
        // Rarely needed: only where resampling cuts a corner closer than the slack allows.
        if sdf.distance(p) < 1.2 * LEAST_DISTANCE_CM {
            *point = pushed_out(sdf, p).into();
        }
    }
}

/// Direction in which hair at `p` from `root` is combed; not of unit length. To both sides of a centre parting and a little
/// back over the head, away from the face at the temples, down everywhere else.
fn combed(p: Vector3<f32>, root: Vector3<f32>) -> Vector3<f32> {
    let over_head = smooth_step(-6.0, 4.0, p.y);
    let front = smooth_step(-7.0, 5.0, p.z);
    let back = over_head * (0.2 + 0.6 * front);
    // A centre parting: hair falls to the side it grows on. Combed straight back over the head it would lie in unstable
    // balance and slide off at the first movement, having no neighbours to lean on.
    let side = 1.2 * (root.x / 1.2).clamp(-1.0, 1.0) * smooth_step(0.0, 7.0, p.y);
    // What reaches the shoulders falls behind them rather than along them.
    let behind = 0.06 + 0.75 * (1.0 - smooth_step(-19.0, -13.0, p.y)) * smooth_step(-9.0, -2.0, p.z);
    Vector3::new(side, -1.0, -back - behind)
}

/// `p`, or the nearest point the drawn distance away from the head.
fn pushed_out(sdf: &SignedDistanceField, mut p: Vector3<f32>) -> Vector3<f32> {
    const ROUNDS: usize = 4;
    for _ in 0..ROUNDS {
        let d = sdf.distance(p);
        if d >= DRAWN_DISTANCE_CM {
            break;
        }
        let (d, normal) = sdf.outward_normal(p);
        p += normal * (DRAWN_DISTANCE_CM - d + 1e-3);
    }
    p
}

/// Phase of a strand's wave at its root, radian. Grows with the way that combed hair takes over the head, so that crests
/// of hair from different roots lie side by side where the hair does; a smooth variation keeps them from being ruled.
fn wave_phase(root: Vector3<f32>, seed: u64) -> f32 {
    const FROM: Vector3<f32> = Vector3::new(0.0, 0.5, 0.866);
    const HEAD_RADIUS_CM: f32 = 9.0;
    let center = Vector3::from(CRANIUM_CENTER);
    let way = HEAD_RADIUS_CM * FROM.angle(&(root - center));
    2.0 * std::f32::consts::PI * way / WAVE_LENGTH_CM + 2.2 * noise(root * 0.18, seed ^ 5)
}

/// Displaces a strand's axis sideways and outwards by a wave that fades in over the first centimetres.
fn wave(sdf: &SignedDistanceField, axis: &mut [Vector3<f32>], phase: f32, amplitudes: [f32; 2]) {
    let straight = axis.to_vec();
    let n = straight.len();
    for i in 1..n {
        let s = i as f32 * STEP_CM;
        let tangent = straight[(i + 1).min(n - 1)] - straight[i - 1];
        let (_, normal) = sdf.outward_normal(straight[i]);
        let Some(sideways) = tangent.cross(&normal).try_normalize(1e-4) else { continue };
        let outwards = sideways.cross(&tangent).try_normalize(1e-4).unwrap_or(normal);
        let (sin, cos) = (2.0 * std::f32::consts::PI * s / WAVE_LENGTH_CM + phase).sin_cos();
        let [aside, out] = amplitudes.map(|a| a * smooth_step(0.5, 5.0, s));
        axis[i] = pushed_out(sdf, straight[i] + sideways * (aside * sin) + outwards * (out * cos));
    }
}

/// `out` along `line` from its start, each `length / (out.len() - 1)` from the one before, so that segments are equal. A
/// line that ends too early is continued straight.
fn resample(line: &[Vector3<f32>], length: f32, out: &mut [[f32; 3]]) {
    let chord = length / (out.len() - 1) as f32;
    let mut here = line[0];
    let mut segment = 0;
    out[0] = here.into();
    for point in &mut out[1..] {
        while segment + 2 < line.len() && (line[segment + 1] - here).norm() < chord {
            segment += 1;
        }
        let (start, along) = (line[segment], line[segment + 1] - line[segment]);
        // The farther crossing of the segment's line with the sphere of one chord about `here`.
        let back = start - here;
        let (a, b, c) = (along.norm_squared(), along.dot(&back), back.norm_squared() - chord * chord);
        let t = if a > 0.0 { (-b + (b * b - a * c).max(0.0).sqrt()) / a } else { 0.0 };
        here = start + along * t;
        *point = here.into();
    }
}

/// Smooth value noise in about -1..1 with features of unit size.
fn noise(p: Vector3<f32>, seed: u64) -> f32 {
    let cell = p.map(f32::floor);
    let t = (p - cell).map(|t| t * t * t * (t * (6.0 * t - 15.0) + 10.0));
    (0..8)
        .map(|c| {
            let corner = [0, 1, 2].map(|k: usize| (c >> k & 1) as f32);
            let weight: f32 = (0..3).map(|k| if corner[k] > 0.0 { t[k] } else { 1.0 - t[k] }).product();
            let at = [0, 1, 2].map(|k: usize| (cell[k] + corner[k]) as i64 as u64);
            weight * hash(at, seed)
        })
        .sum()
}

/// A number in -1..1 for each lattice point.
fn hash(at: [u64; 3], seed: u64) -> f32 {
    let mut h = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    for x in at {
        h = (h ^ x).wrapping_mul(0xff51_afd7_ed55_8ccd);
        h ^= h >> 32;
    }
    (h >> 40) as f32 / (1u64 << 23) as f32 - 1.0
}

fn smooth_step(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::head;

    const PARTICLES: usize = 25;
    const LENGTH_CM: f32 = 25.0;
    const ON_SURFACE_CM: f32 = 0.05;
    /// Chords are equal but for the few particles that are moved off the head after resampling.
    const UNEVEN: f32 = 0.02;

    fn grow_all(head: &Solid, style: Style, strands: usize, seed: u64) -> UniformGroom {
        generate(&GroomParams { style, strands, particles: PARTICLES, length_cm: LENGTH_CM, seed, head })
            .expect("a head of hair")
    }

    fn check(style: Style) {
        let head = head().expect("the built-in head");
        let groom = grow_all(&head, style, 5_000, 1);
        assert_eq!((groom.n_strands, groom.n_particles), (5_000, PARTICLES));
        assert_eq!(groom.points.len(), 5_000 * PARTICLES);
        for i in 0..groom.n_strands {
            let strand = groom.strand(i);
            let chord: Vec<f32> =
                strand.windows(2).map(|w| (Vector3::from(w[1]) - Vector3::from(w[0])).norm()).collect();
            let mean = chord.iter().sum::<f32>() / chord.len() as f32;
            for (n, p) in strand.iter().enumerate() {
                let d = head.sdf.distance(Vector3::from(*p));
                assert!(p.iter().all(|x| x.is_finite()), "strand {i} particle {n}");
                if n == 0 {
                    assert!(d.abs() < ON_SURFACE_CM, "root {i} is {d} from the surface");
                } else {
                    assert!(d >= LEAST_DISTANCE_CM, "strand {i} particle {n} is only {d} away");
                    let off = (chord[n - 1] / mean - 1.0).abs();
                    assert!(off < UNEVEN, "strand {i} particle {n}: spacing {} of {mean}", chord[n - 1]);
                }
            }
            let length: f32 = chord.iter().sum();
            assert!((0.89 * LENGTH_CM..=1.11 * LENGTH_CM).contains(&length), "strand {i} is {length} long");
        }
    }

    #[test]
    fn straight_hair_is_evenly_spaced_and_outside_the_head() {
        check(Style::Straight);
    }

    #[test]
    fn wavy_hair_is_evenly_spaced_and_outside_the_head() {
        check(Style::Wavy);
    }

    #[test]
    fn curly_hair_is_evenly_spaced_and_outside_the_head() {
        check(Style::Curly);
    }

    #[test]
    fn a_seed_decides_every_byte_for_any_number_of_threads() {
        let head = head().expect("the built-in head");
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        let alone = one.install(|| grow_all(&head, Style::Wavy, 500, 7));
        assert_eq!(alone, grow_all(&head, Style::Wavy, 500, 7));
        assert_ne!(alone, grow_all(&head, Style::Wavy, 500, 8));
    }

    #[test]
    fn fewer_strands_are_a_prefix_of_more() {
        let head = head().expect("the built-in head");
        let few = grow_all(&head, Style::Straight, 200, 3);
        let more = grow_all(&head, Style::Straight, 400, 3);
        assert_eq!(few.points, more.points[..few.points.len()]);
    }

    #[test]
    fn hair_covers_a_ball_evenly_and_any_prefix_does() {
        let ball = crate::shapes::sphere(8.0).expect("a ball");
        let grow = |strands| {
            let params =
                GroomParams { style: Style::Straight, strands, particles: 30, length_cm: 10.0, seed: 1, head: &ball };
            on_ball(&params, 8.0).expect("a groom")
        };
        let (few, more) = (grow(800), grow(3_200));
        assert_eq!(few.points, more.points[..few.points.len()]);
        for groom in [&few, &more] {
            // Each eighth of the ball has its share, within a tenth.
            let mut octants = [0usize; 8];
            for s in 0..groom.n_strands {
                let [x, y, z] = groom.strand(s)[0];
                octants[usize::from(x > 0.0) + 2 * usize::from(y > 0.0) + 4 * usize::from(z > 0.0)] += 1;
                for (i, &p) in groom.strand(s).iter().enumerate() {
                    let distance = Vector3::from(p).norm() - 8.0;
                    assert!(if i == 0 { distance.abs() < 1e-5 } else { distance > 0.05 }, "strand {s}: {distance}");
                }
            }
            let share = groom.n_strands / 8;
            assert!(octants.iter().all(|&n| n.abs_diff(share) * 10 <= share), "{octants:?}");
        }
    }

    #[test]
    fn roots_cover_the_scalp_evenly_and_leave_the_face_free() {
        let head = head().expect("the built-in head");
        let groom = grow_all(&head, Style::Straight, 4_000, 1);
        let roots: Vec<Vector3<f32>> = (0..4_000).map(|i| Vector3::from(groom.strand(i)[0])).collect();
        let nearest = |i: usize| {
            (0..roots.len()).filter(|&j| j != i).map(|j| (roots[i] - roots[j]).norm()).fold(f32::INFINITY, f32::min)
        };
        let mut gaps: Vec<f32> = (0..roots.len()).step_by(10).map(nearest).collect();
        gaps.sort_by(f32::total_cmp);
        // Random points have many close pairs: their lower decile is 0.38 of the median.
        assert!(gaps[gaps.len() / 10] > 0.6 * gaps[gaps.len() / 2]);
        // Eyes, nose and mouth.
        assert!(roots.iter().all(|r| r.z < 4.5 || r.y > 2.5));
    }

    #[test]
    fn neighbouring_hairs_are_combed_alike() {
        let head = head().expect("the built-in head");
        let groom = grow_all(&head, Style::Wavy, 4_000, 1);
        let mut spread: Vec<f32> = (0..4_000)
            .step_by(20)
            .map(|i| {
                let root = Vector3::from(groom.strand(i)[0]);
                let near = (0..4_000)
                    .filter(|&j| j != i)
                    .min_by(|&a, &b| {
                        let d = |j: usize| (Vector3::from(groom.strand(j)[0]) - root).norm();
                        d(a).total_cmp(&d(b))
                    })
                    .unwrap_or(i);
                (Vector3::from(groom.strand(i)[PARTICLES - 1]) - Vector3::from(groom.strand(near)[PARTICLES - 1]))
                    .norm()
            })
            .collect();
        spread.sort_by(f32::total_cmp);
        // A tenth of the length apart at the tips.
        assert!(spread[spread.len() / 2] < 0.1 * LENGTH_CM, "median {}", spread[spread.len() / 2]);
    }
}
