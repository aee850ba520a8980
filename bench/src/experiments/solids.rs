//! The solids of AS16 §7.3: gears cut through, a hairy ball dragged over toys (Fig. 12), and a hand that closes in the salon's hair.
//!
//! Scanned toys are used where the place has them, closed forms elsewhere; the text says which. The hand is sixteen rigid bones
//! that move as an animated hand's do, since hair meets rigid solids one by one, and bodies that change their shape only by guides.

use super::heads::{SALON, adaptive, amount, own_scene, salon};
use super::watch::{Row, Watched, reference, side_by_side, watch};
use super::words::{ALIKE_PCT, alike, claim, kept_out, table, watched};
use crate::error::Error;
use crate::evidence::{Experiment, Findings, Place, Trained};
use crate::run::Mode;
use crate::runtime_bench::Subject;
use crate::shapes::solid_mesh;
use crate::shapes_hand::{bone_motions, finger_bones, palm};
use crate::world::World;
use io_formats::groom::LengthUnit;
use io_formats::scene::{Attach, CameraSpec, HeadSpec, KeySpec, MeshSource, MotionSpec, Scene, SolidShape, SolidSpec};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// Gears.
pub const GEARS: Experiment =
    Experiment { name: "gears", title: "Gear set", source: "AS16 §7.3, Fig. 10, Table 2", run: gears };

/// The hairy ball.
pub const BALL: Experiment =
    Experiment { name: "hairy-ball", title: "Hairy ball among toys", source: "AS16 §7.3, Fig. 12", run: ball };

/// The hand.
pub const HAND: Experiment =
    Experiment { name: "hand", title: "A hand closes in the hair", source: "AS16 §7.3, Fig. 13", run: hand };

/// Ways compared.
const WAYS: [(Mode, &str); 2] = [(Mode::Adaptive, "ours"), (Mode::Fixed, "fixed sets")];

/// What one of the three is called and where the paper has it.
struct Told<'a> {
    name: &'a str,
    source: &'a str,
    claim: &'a str,
    why: &'a str,
}

/// Runs the ways in a scene: table, pictures, claim, measures.
fn compared(
    place: &dyn Place,
    subject: &Subject,
    sizes: (usize, usize),
    moments: &[f64],
    told: &Told,
) -> Result<Findings, Error> {
    let size = amount(place.size(), sizes.0, sizes.1);
    let against = reference(place, subject, size.measured, size.reference, moments)?;
    let mut found = Vec::new();
    for (mode, name) in WAYS {
        let Some(params) = mode.params() else { continue };
        found.push((name, watch(place, &Subject { params, ..*subject }, &against, moments)?));
    }
    let named: Vec<(&str, &Watched)> = found.iter().map(|(name, way)| (*name, way)).collect();
    let mut out = Findings { tables: vec![table(&subject.size(), &against, &named)], ..Findings::default() };
    for (at, &t) in moments.iter().enumerate() {
        let mut shown = vec![("full space", against.shots[at].as_slice())];
        shown.extend(named.iter().map(|(name, way)| (*name, way.shots[at].as_slice())));
        let all = format!("ours, all {} hairs", subject.model.n_strands);
        let row = format!("{}-{at}", told.name);
        let marked = Row { name: &row, t, n_strands: size.reference, marks: true };
        out.pictures.extend(side_by_side(place, subject.world, marked, &shown)?);
        let whole = Row { n_strands: usize::MAX, marks: false, ..marked };
        out.pictures.extend(side_by_side(place, subject.world, whole, &[(&all, &named[0].1.shots[at])])?);
    }
    let (ours, fixed) = (named[0].1, named[1].1);
    let (m, f) = (&ours.quality.measured, &fixed.quality.measured);
    out.claims.push(claim(
        told.source,
        told.claim,
        "shown in pictures",
        format!(
            "{:.2} % of near hairs in reach inside, {:.2} % passed through (fixed sets {:.1} and {:.1} %, full space {:.2} and {:.2} %)",
            m.near_strands_inside_pct,
            m.passed_through_pct,
            f.near_strands_inside_pct,
            f.passed_through_pct,
            against.run.measured.near_strands_inside_pct,
            against.run.measured.passed_through_pct
        ),
        kept_out(m),
        told.why,
    ));
    let [error, error_fixed] = [ours, fixed].map(|way| way.error_pct()[0]);
    out.claims.push(claim(
        told.source,
        "Results are similar to those of full-space simulation.",
        "shown in pictures",
        format!("error of near hairs {error:.2} % of length, {error_fixed:.2} % with fixed sets"),
        alike(ours, fixed),
        if error_fixed > ALIKE_PCT {
            "The reduced model itself is that far off, whichever sets are taken."
        } else {
            ""
        },
    ));
    out.measures = watched("ours", ours, &against);
    Ok(out)
}

fn gears(place: &dyn Place) -> Result<Findings, Error> {
    const SIZES: (usize, usize) = (80_000, 300);
    let head = place.trained(own_scene(place, "gears", SIZES.0, SIZES.1)?)?;
    let told = Told {
        name: "gears",
        source: "AS16 §7.3, Gear Set",
        claim: "Long hair over gears with cavities that turn unevenly fully contacts these detailed solids, without hair inside them.",
        why: "",
    };
    let mut out = compared(place, &adaptive(&head), SIZES, &[0.6, 1.1, 1.8], &told)?;
    out.paragraphs.push(
        "Two gears that lie flat come into 36 cm long hair from behind and turn against each other, forwards, back and forwards again; \
         between their spokes they are cut through. Hair that is inside a gear is drawn red."
            .to_owned(),
    );
    Ok(out)
}

/// A toy: file, cm per unit, where it stands (cm), how it is turned (degrees).
type Toy = (&'static str, f64, [f64; 3], [f64; 3]);

const TOYS: [Toy; 3] = [
    ("solids/bunny.obj", 10.0, [28.0, -6.0, 0.0], [0.0, 0.0, 0.0]),
    ("solids/horse.ply", 120.0, [-28.0, -6.0, 0.0], [0.0, 0.0, 90.0]),
    ("solids/armadillo.obj", 20.0, [0.0, -34.0, 0.0], [0.0, 0.0, 0.0]),
];

/// The way of the ball: times and places, s and cm.
const DRAGGED: [(f64, [f64; 3], [f64; 3]); 6] = [
    (0.0, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    (0.5, [9.0, -2.0, 0.0], [0.0, 30.0, 0.0]),
    (0.8, [8.0, 4.0, 0.0], [0.0, 30.0, 20.0]),
    (1.4, [-9.0, 0.0, 0.0], [0.0, -20.0, 20.0]),
    (1.9, [-3.0, -7.0, 0.0], [0.0, 0.0, 0.0]),
    (2.4, [3.0, -8.0, 0.0], [0.0, 20.0, 0.0]),
];

fn ball(place: &dyn Place) -> Result<Findings, Error> {
    const SIZES: (usize, usize) = (60_000, 200);
    let head = place.trained(own_scene(place, "hairy-ball", SIZES.0, SIZES.1)?)?;
    let mut told = Told {
        name: "hairy-ball",
        source: "AS16 §7.3, Fig. 12",
        claim: "A ball with 60,000 hairs is dragged over toys, smooth ones and sharp ones, and its hair stays out of them.",
        why: "The ball moves faster and farther than what its model was trained on, a second of head motion, and the error says so of both ways.",
    };
    let Some(scene) = toys(place, &head.world.scene) else {
        told.why = "Scanned toys were not at hand; a ball and a comb stand in for them.";
        let mut out = compared(place, &adaptive(&head), SIZES, &[0.6, 1.1, 1.8], &told)?;
        out.paragraphs.push("A hairy ball is moved against a smooth ball and a comb.".to_owned());
        return Ok(out);
    };
    let world = head.world.staged(scene, None)?;
    let subject = Subject { world: &world, ..adaptive(&head) };
    let mut out = compared(place, &subject, SIZES, &[0.6, 1.4, 2.1], &told)?;
    out.paragraphs.push(
        "A hairy ball is dragged over a bunny, a horse and an armadillo, scanned: backs that are smooth, ears, fingers and legs that are \
         not. The motion is prescribed, where the paper's users moved it by hand. Hair that is inside a toy is drawn red."
            .to_owned(),
    );
    Ok(out)
}

/// The scene of the ball with the scanned toys; none where one is missing.
fn toys(place: &dyn Place, scene: &Scene) -> Option<Scene> {
    let mut solids = Vec::new();
    for (file, cm_per_unit, translate_cm, rotate_deg) in TOYS {
        let unit = LengthUnit::Other(cm_per_unit);
        let source = MeshSource { path: place.data(file)?, unit, center: true, rotate_deg };
        let key = KeySpec { t: 0.0, translate_cm, rotate_deg: [0.0; 3] };
        let name = file.trim_start_matches("solids/").split('.').next().unwrap_or(file);
        solids.push(solid(name, SolidShape::Mesh(source), vec![key]));
    }
    let keys = DRAGGED.map(|(t, translate_cm, rotate_deg)| KeySpec { t, translate_cm, rotate_deg });
    let motion = MotionSpec::Keys(keys.to_vec());
    let head = HeadSpec { motion, ..scene.head.clone() };
    let camera = CameraSpec { eye_cm: [0.0, 2.0, 122.0], target_cm: [0.0, -12.0, 0.0], ..scene.camera };
    Some(Scene { solids, head, camera, seconds: 2.4, name: "hairy-ball-toys".to_owned(), ..scene.clone() })
}

fn solid(name: &str, shape: SolidShape, keys: Vec<KeySpec>) -> SolidSpec {
    SolidSpec { name: name.to_owned(), shape, friction: 0.1, attach: Attach::World, motion: MotionSpec::Keys(keys) }
}

/// Where the palm is and how far the hand has closed: s, cm, 0 to 1.
const HAND_KEYS: [(f64, [f64; 3], f64); 6] = [
    (0.0, [0.0, -6.0, -30.0], 0.0),
    (0.4, [0.0, -7.0, -20.0], 0.1),
    (1.1, [0.0, -12.0, -20.0], 0.35),
    (1.5, [0.0, -14.0, -20.5], 0.75),
    (2.0, [0.0, -16.0, -25.0], 0.75),
    (2.4, [0.0, -16.0, -36.0], 0.2),
];
/// Key poses of each bone a second.
const HAND_RATE: f64 = 25.0;

fn hand_at(t: f64) -> ([f64; 3], f64) {
    let after = HAND_KEYS.iter().position(|k| k.0 > t).unwrap_or(HAND_KEYS.len() - 1).max(1);
    let (a, b) = (HAND_KEYS[after - 1], HAND_KEYS[after]);
    let x = ((t - a.0) / (b.0 - a.0)).clamp(0.0, 1.0);
    let x = x * x * (3.0 - 2.0 * x);
    (std::array::from_fn(|c| a.1[c] + x * (b.1[c] - a.1[c])), a.2 + x * (b.2 - a.2))
}

/// The salon's scene with the bones of a hand for its solids: a stand-in for the palm first, which is no shape of scenes, then rods.
fn hand_scene(scene: &Scene) -> Scene {
    let bones = finger_bones();
    let mut keys: Vec<Vec<KeySpec>> = vec![Vec::new(); 1 + bones.len()];
    let seconds = HAND_KEYS[HAND_KEYS.len() - 1].0;
    for step in 0..=(seconds * HAND_RATE).round() as usize {
        let t = step as f64 / HAND_RATE;
        let (at, closing) = hand_at(t);
        // Fingers, along y of the hand, point at the head; the palm, towards +z of it, looks down.
        let hand = Isometry3::from_parts(
            Translation3::from(Vector3::from(at)),
            UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2),
        );
        for (k, motion) in bone_motions(closing as f32).into_iter().enumerate() {
            let rod = k.checked_sub(1).map_or_else(Isometry3::identity, |k| {
                let (a, b, _) = bones[k];
                let turn = UnitQuaternion::rotation_between(&Vector3::y(), &(b - a)).unwrap_or_default();
                Isometry3::from_parts(Translation3::from((a + b) * 0.5), turn)
            });
            let pose = hand * (motion * rod).cast::<f64>();
            let (x, y, z) = pose.rotation.euler_angles();
            let rotate_deg = [x, y, z].map(f64::to_degrees);
            keys[k].push(KeySpec { t, translate_cm: pose.translation.vector.into(), rotate_deg });
        }
    }
    let mut keys = keys.into_iter();
    let stand_in = SolidShape::Sphere { radius_cm: 1.0 };
    let mut solids = vec![solid("palm", stand_in, keys.next().unwrap_or_default())];
    for (k, ((a, b, radius), keys)) in bones.into_iter().zip(keys).enumerate() {
        let shape = SolidShape::Rod { radius_cm: f64::from(radius), length_cm: f64::from((b - a).norm()) };
        solids.push(solid(&format!("bone {}", k + 1), shape, keys));
    }
    Scene { name: "hand".to_owned(), seconds, solids, ..scene.clone() }
}

/// The salon's head with the hand.
fn hand_world(head: &Trained) -> Result<World, Error> {
    let mut world = head.world.staged(hand_scene(&head.world.scene), None)?;
    let mut flat = palm()?;
    flat.friction = world.solids[0].friction;
    world.solid_meshes[0] = solid_mesh(&flat);
    world.solids[0] = flat;
    Ok(world)
}

fn hand(place: &dyn Place) -> Result<Findings, Error> {
    let head = salon(place)?;
    let world = hand_world(&head)?;
    let told = Told {
        name: "hand",
        source: "AS16 §7.3, Fig. 13",
        claim: "A full head of hair interacts with an animated hand, and collisions are well resolved.",
        why: "The hand is made of a palm and fifteen rigid bones of fingers that move as an animated hand's; its skin does not deform.",
    };
    let subject = Subject { world: &world, ..adaptive(&head) };
    let mut out = compared(place, &subject, SALON, &[0.8, 1.5, 1.9], &told)?;
    out.paragraphs.push(
        "A hand comes from behind with its fingers spread, rakes down through the hair, closes, and is drawn away. Hair that is inside a \
         bone is drawn red."
            .to_owned(),
    );
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn the_bones_of_the_hand_stay_joined_while_it_moves_and_closes() {
        /// Of rotations written as angles in degrees, and of poses between keys.
        const JOINED_CM: f64 = 0.1;
        let text = "name = \"h\"\n[groom]\ngenerator = { style = \"straight\", strands = 10 }\nguides = 2\n";
        let scene = hand_scene(&Scene::from_toml(text, Path::new("")).expect("a scene"));
        let poses: Vec<_> =
            scene.solids.iter().map(|s| s.motion.load(scene.seconds, [0.0; 3]).expect("a motion")).collect();
        let bones = finger_bones();
        for step in 0..48 {
            let t = 0.05 * f64::from(step);
            for finger in 0..5 {
                for joint in 0..2 {
                    let k = 3 * finger + joint;
                    let end = |k: usize, sign: f64| {
                        let half = 0.5 * f64::from((bones[k].1 - bones[k].0).norm());
                        poses[1 + k].pose_at(t).transform_point(&(Vector3::y() * sign * half).into())
                    };
                    let gap = (end(k, 1.0) - end(k + 1, -1.0)).norm();
                    assert!(gap < JOINED_CM, "{t} s, finger {finger}, joint {joint}: {gap} cm");
                }
            }
        }
    }

    #[test]
    fn the_hand_goes_smoothly_through_its_keys() {
        /// Of a sum that ends where a key is.
        const ROUND_OFF: f64 = 1e-12;
        for (t, at, closing) in HAND_KEYS {
            let (there, closed) = hand_at(t);
            let off = (0..3).map(|c| (there[c] - at[c]).abs()).fold((closed - closing).abs(), f64::max);
            assert!(off < ROUND_OFF, "{t} s: {off}");
        }
        assert!((hand_at(9.0).1 - HAND_KEYS[HAND_KEYS.len() - 1].2).abs() < ROUND_OFF);
    }
}
