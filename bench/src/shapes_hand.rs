//! A generated hand that closes and opens: one closed mesh of one topology, for bodies that deform (MS08 §5.1).
//!
//! A palm and five fingers of capsules, blended, are marched once in the open pose. Every vertex is bound to the bones near it
//! with weights that fade smoothly, and carried by the mean of their motions. The hand lies in the x-y plane, fingers
//! along y, palm towards +z; a closing of 0 is open, 1 a fist about a stick.

use collision::{Bounds, KeyedMesh, Shape, ShapeUnion, Solid, bake_from_fn};
use io_formats::TriMesh;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::error::Error;
use crate::shapes::{DEFAULT_FRICTION, surface};

/// A finger as in [`FINGERS`].
type Finger = ([f32; 3], [f32; 3], [f32; JOINTS], [f32; 2]);

/// Bones of a finger.
const JOINTS: usize = 3;
/// Where each finger begins, the way it points in the open hand, bone lengths, and radius at its root and tip, cm; the thumb first.
const FINGERS: [Finger; 5] = [
    ([-3.4, -2.2, 0.2], [-0.75, 0.66, 0.0], [3.0, 2.4, 1.9], [1.0, 0.75]),
    ([-2.9, 3.9, 0.0], [-0.10, 1.0, 0.0], [3.4, 2.1, 1.5], [0.80, 0.58]),
    ([-0.9, 4.2, 0.0], [0.0, 1.0, 0.0], [3.8, 2.4, 1.6], [0.82, 0.60]),
    ([1.1, 4.0, 0.0], [0.06, 1.0, 0.0], [3.5, 2.2, 1.6], [0.78, 0.57]),
    ([3.0, 3.4, 0.0], [0.16, 1.0, 0.0], [2.7, 1.7, 1.4], [0.68, 0.50]),
];
/// How far each joint bends in a fist, radian.
const BEND: [f32; JOINTS] = [1.3, 1.5, 0.9];
/// The thumb bends less.
const THUMB_BEND: [f32; JOINTS] = [0.5, 0.6, 0.7];
/// Half the thickness of the palm, cm.
const PALM_HALF_CM: f32 = 1.2;
/// Width of the blend between neighbouring parts, cm; narrow enough to leave the fingers apart.
const BLEND_CM: f32 = 0.35;
/// Weights fade over this distance beyond the nearest bone, cm.
const FADE_CM: f32 = 0.5;

/// A hand bound to its bones.
#[derive(Debug, Clone)]
pub struct Hand {
    /// The open hand.
    pub mesh: TriMesh,
    /// For each vertex, its weight on each bone; bone 0 is the palm, then finger by finger from the root.
    weights: Vec<[f32; N_BONES]>,
}

const N_BONES: usize = 1 + FINGERS.len() * JOINTS;

/// Ends of the bones of a finger in the open hand.
fn bone_ends(finger: usize) -> [Vector3<f32>; JOINTS + 1] {
    let (root, along, lengths, _) = FINGERS[finger];
    let along = Vector3::from(along).normalize();
    let mut ends = [Vector3::from(root); JOINTS + 1];
    for k in 0..JOINTS {
        ends[k + 1] = ends[k] + along * lengths[k];
    }
    ends
}

fn parts() -> ShapeUnion {
    let palm = Shape::Box { center: Vector3::zeros(), half: Vector3::new(3.9, 4.4, PALM_HALF_CM), rounding: 1.1 };
    let mut shapes = vec![palm];
    for (finger, &(_, _, lengths, [thick, thin])) in FINGERS.iter().enumerate() {
        let ends = bone_ends(finger);
        let whole: f32 = lengths.iter().sum();
        let radius = |k: usize| thick + (thin - thick) * lengths[..k].iter().sum::<f32>() / whole;
        for k in 0..JOINTS {
            shapes.push(Shape::Capsule { a: ends[k], b: ends[k + 1], radius_a: radius(k), radius_b: radius(k + 1) });
        }
    }
    ShapeUnion { shapes, smoothing: BLEND_CM }
}

impl Hand {
    /// Marches the open hand at a spacing, cm, and binds it.
    ///
    /// # Errors
    /// A spacing that is not positive, or too fine to bake.
    pub fn new(spacing_cm: f32) -> Result<Self, Error> {
        let shape = parts();
        let named = |source| Error::Bake { name: "hand".to_owned(), source };
        let bounds = shape.bounds().unwrap_or(Bounds::new(Vector3::zeros(), Vector3::zeros()));
        let sdf = bake_from_fn(bounds.grown(2.0 * spacing_cm), spacing_cm, |p| shape.distance(p)).map_err(named)?;
        let mesh = surface(&sdf, spacing_cm);
        let weights = mesh.vertices.iter().map(|&v| weights_at(&shape, v.into())).collect();
        Ok(Self { mesh, weights })
    }

    /// Vertex positions at a closing between 0 and 1, cm.
    #[must_use]
    pub fn posed(&self, closing: f32) -> Vec<[f32; 3]> {
        let bones = bones(closing);
        let pose = |(v, weights): (&[f32; 3], &[f32; N_BONES])| {
            let p = Point3::from(*v);
            let sum: Vector3<f32> = bones.iter().zip(weights).map(|(bone, &w)| (bone * p).coords * w).sum();
            sum.into()
        };
        self.mesh.vertices.iter().zip(&self.weights).map(pose).collect()
    }

    /// `n` frames at equal times of a hand that closes and opens once.
    #[must_use]
    pub fn closing_and_opening(&self, n: usize) -> Vec<Vec<[f32; 3]>> {
        (0..n)
            .map(|k| {
                let phase = std::f32::consts::TAU * k as f32 / n.saturating_sub(1).max(1) as f32;
                self.posed(0.5 - 0.5 * phase.cos())
            })
            .collect()
    }

    /// Frames and their times as a deforming solid takes them.
    #[must_use]
    pub fn keyed<'a>(&'a self, times_s: &'a [f64], frames: &'a [Vec<[f32; 3]>]) -> KeyedMesh<'a> {
        KeyedMesh { times_s, positions: frames, triangles: &self.mesh.triangles }
    }
}

/// A bone of a finger as a capsule of the open hand: both ends and the mean radius, cm.
pub type FingerBone = (Vector3<f32>, Vector3<f32>, f32);

/// The bones of all fingers, in the order of [`bone_motions`] after the palm.
#[must_use]
pub fn finger_bones() -> Vec<FingerBone> {
    let capsule = |shape: &Shape| match *shape {
        Shape::Capsule { a, b, radius_a, radius_b } => Some((a, b, 0.5 * (radius_a + radius_b))),
        _ => None,
    };
    parts().shapes.iter().filter_map(capsule).collect()
}

/// The palm alone.
///
/// # Errors
/// None that its shape allows.
pub fn palm() -> Result<Solid, Error> {
    let shapes = parts().shapes.into_iter().take(1).collect();
    Solid::from_shape("palm", &ShapeUnion { shapes, smoothing: 0.0 }, 0.2, PALM_HALF_CM, DEFAULT_FRICTION)
        .map_err(|source| Error::Bake { name: "palm".to_owned(), source })
}

/// How each bone has moved from the open hand, the palm first, which stays.
#[must_use]
pub fn bone_motions(closing: f32) -> Vec<Isometry3<f32>> {
    bones(closing).to_vec()
}

/// Motions of all bones from the open hand.
fn bones(closing: f32) -> [Isometry3<f32>; N_BONES] {
    let mut out = [Isometry3::identity(); N_BONES];
    for (finger, &(_, along, _, _)) in FINGERS.iter().enumerate() {
        let ends = bone_ends(finger);
        let bend = if finger == 0 { THUMB_BEND } else { BEND };
        // Towards the palm's side.
        let hinge = UnitQuaternion::rotation_between(&Vector3::y(), &Vector3::from(along).normalize())
            .unwrap_or_else(UnitQuaternion::identity)
            * Vector3::x();
        let mut carried = Isometry3::identity();
        for k in 0..JOINTS {
            let turn = UnitQuaternion::from_scaled_axis(hinge * (bend[k] * closing));
            let about = Translation3::from(ends[k]);
            carried *= about * turn * about.inverse();
            out[1 + finger * JOINTS + k] = carried;
        }
    }
    out
}

/// Weights of the bones at a point of the surface: by how much farther than the nearest each is.
fn weights_at(shape: &ShapeUnion, p: Vector3<f32>) -> [f32; N_BONES] {
    let distances: Vec<f32> = shape.shapes.iter().map(|s| s.distance(p)).collect();
    let nearest = distances.iter().copied().fold(f32::INFINITY, f32::min);
    let mut weights = [0.0; N_BONES];
    for (w, d) in weights.iter_mut().zip(&distances) {
        let x = ((d - nearest) / FADE_CM).min(1.0);
        *w = (1.0 - x * x).powi(2);
    }
    let sum: f32 = weights.iter().sum();
    weights.map(|w| w / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rigid_bones_lie_inside_the_hand_that_they_move_whatever_its_closing() {
        // Skin that follows the mean of its bones gets thin where a fist bends them; a bone that were elsewhere would be centimetres off.
        const SKIN_CM: f32 = 0.5;
        let hand = Hand::new(0.2).unwrap();
        for closing in [0.0, 0.5, 1.0] {
            let motions = bone_motions(closing);
            assert_eq!(motions.len(), 1 + finger_bones().len());
            let skin = hand.posed(closing);
            for ((a, b, radius), motion) in finger_bones().into_iter().zip(&motions[1..]) {
                let middle = motion * Point3::from((a + b) * 0.5);
                let nearest = skin.iter().map(|v| (Point3::from(*v) - middle).norm()).fold(f32::INFINITY, f32::min);
                assert!((nearest - radius).abs() < SKIN_CM, "{closing}: {nearest} for {radius}");
            }
        }
        assert!(palm().unwrap().sdf.distance(Vector3::zeros()) < -1.0);
    }

    #[test]
    fn a_hand_stays_one_closed_surface_and_its_fingertips_come_round() {
        let hand = Hand::new(0.2).unwrap();
        assert!(hand.mesh.is_closed(), "{} edges", hand.mesh.boundary_edge_count());
        assert_eq!(hand.posed(0.0).len(), hand.mesh.vertices.len());
        let volume = |points: &[[f32; 3]]| {
            let at = |v: u32| Vector3::from(points[v as usize]);
            hand.mesh.triangles.iter().map(|t| at(t[0]).dot(&at(t[1]).cross(&at(t[2]))) / 6.0).sum::<f32>()
        };
        let open = volume(&hand.posed(0.0));
        assert!(open > 50.0, "{open} cm3");
        for frame in hand.closing_and_opening(9) {
            assert!((volume(&frame) / open - 1.0).abs() < 0.2, "{} of {open}", volume(&frame));
        }
        // The tip of the middle finger comes from in front of the palm to over it.
        let tip = (0..hand.mesh.vertices.len())
            .max_by(|&a, &b| hand.mesh.vertices[a][1].total_cmp(&hand.mesh.vertices[b][1]))
            .unwrap();
        let closed = hand.posed(1.0)[tip];
        assert!(hand.mesh.vertices[tip][1] > 10.0 && closed[1] < 6.0 && closed[2] > 1.0, "{closed:?}");
    }
}
