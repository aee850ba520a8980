//! The scene file's shape as written, turned into the public types: one of several sources each, defaults filled in.
//!
//! Every table refuses unknown fields. Where alternatives exclude each other, the message says which were given.

use std::path::PathBuf;

use serde::Deserialize;
use serde::de::{self, Deserializer, Visitor};

use super::{
    Attach, CameraSpec, GeneratorSpec, GroomSource, GroomSpec, HairStyle, HeadShape, HeadSpec, KeySpec, MaterialSpec,
    MeshSource, MotionSpec, MotionUse, RecordedSpec, SolidShape, SolidSpec, TrainSpec,
};
use crate::groom::LengthUnit;

pub(super) fn seconds() -> f64 {
    4.0
}
pub(super) fn step_s() -> f64 {
    0.01
}
pub(super) fn fps() -> f64 {
    24.0
}
pub(super) fn seed() -> u64 {
    1
}
pub(super) fn length_cm() -> f64 {
    25.0
}
pub(super) fn preset() -> HairStyle {
    HairStyle::Straight
}
fn particles() -> usize {
    25
}
fn guides() -> usize {
    100
}
fn max_eligible() -> usize {
    9
}
fn friction() -> f64 {
    0.3
}

impl Default for MaterialSpec {
    fn default() -> Self {
        Self {
            preset: preset(),
            stretch_dyn: None,
            bend: None,
            twist: None,
            stretch_damping: None,
            bend_damping: None,
            twist_damping: None,
            friction: None,
            linear_density_g_per_cm: None,
            air_drag_per_s: None,
        }
    }
}

impl Default for TrainSpec {
    fn default() -> Self {
        Self {
            sequences: 6,
            seconds_per_sequence: 4.0,
            fps: 25.0,
            seed: 7,
            sparsity: 0.015,
            min_weight: 0.01,
            friction: false,
            validation_seconds: 0.0,
            held_out_seconds: 4.0,
            recorded: Vec::new(),
        }
    }
}

impl Default for CameraSpec {
    fn default() -> Self {
        Self { eye_cm: [0.0, 5.0, 80.0], target_cm: [0.0, -4.0, 0.0], vertical_fov_deg: 35.0, width: 768, height: 768 }
    }
}

impl<'de> Deserialize<'de> for LengthUnit {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct UnitVisitor;
        impl Visitor<'_> for UnitVisitor {
            type Value = LengthUnit;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("\"m\", \"cm\", \"mm\", \"in\" or the number of centimetres per unit")
            }
            fn visit_str<E: de::Error>(self, s: &str) -> Result<LengthUnit, E> {
                s.parse().map_err(E::custom)
            }
            fn visit_f64<E: de::Error>(self, x: f64) -> Result<LengthUnit, E> {
                x.to_string().parse().map_err(E::custom)
            }
            fn visit_i64<E: de::Error>(self, x: i64) -> Result<LengthUnit, E> {
                x.to_string().parse().map_err(E::custom)
            }
        }
        deserializer.deserialize_any(UnitVisitor)
    }
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Axis {
    X,
    Y,
    Z,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawGroom {
    file: Option<PathBuf>,
    unit: Option<LengthUnit>,
    negate: Option<Vec<Axis>>,
    translate_cm: Option<[f64; 3]>,
    generator: Option<GeneratorSpec>,
    #[serde(default = "particles")]
    particles: usize,
    #[serde(default = "guides")]
    guides: usize,
    #[serde(default = "max_eligible")]
    max_eligible: usize,
    #[serde(default)]
    drop_degenerate: bool,
    densify_to: Option<usize>,
}

impl TryFrom<RawGroom> for GroomSpec {
    type Error = String;

    fn try_from(raw: RawGroom) -> Result<Self, String> {
        let source = match (raw.file, raw.generator) {
            (Some(path), None) => {
                let mut negate = [false; 3];
                for axis in raw.negate.unwrap_or_default() {
                    negate[axis as usize] = true;
                }
                GroomSource::File {
                    path,
                    unit: raw.unit.ok_or("groom.unit is required with groom.file, it is never guessed")?,
                    negate,
                    translate_cm: raw.translate_cm.unwrap_or_default(),
                }
            }
            (None, Some(generator)) => {
                if raw.unit.is_some() || raw.negate.is_some() || raw.translate_cm.is_some() || raw.densify_to.is_some()
                {
                    return Err("groom.unit, negate, translate_cm and densify_to go with groom.file only".into());
                }
                GroomSource::Generated(generator)
            }
            (Some(_), Some(_)) => return Err("groom has both a file and a generator, give one".into()),
            (None, None) => return Err("groom needs a file or a generator".into()),
        };
        Ok(Self {
            source,
            particles: raw.particles,
            guides: raw.guides,
            max_eligible: raw.max_eligible,
            drop_degenerate: raw.drop_degenerate,
            densify_to: raw.densify_to,
        })
    }
}

/// The fields of a motion, shared by `[head.motion]` and `[[solid]]`.
#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct RawMotion {
    keys: Option<Vec<KeySpec>>,
    bvh: Option<PathBuf>,
    joint: Option<String>,
    unit: Option<LengthUnit>,
    skip_frames: Option<usize>,
    yaw_deg: Option<f64>,
    repeat: Option<bool>,
}

impl RawMotion {
    fn build(self, table: &str) -> Result<MotionSpec, String> {
        let bvh_only = self.joint.is_some()
            || self.unit.is_some()
            || self.skip_frames.is_some()
            || self.yaw_deg.is_some()
            || self.repeat.is_some();
        match (self.keys, self.bvh) {
            (Some(_), Some(_)) => Err(format!("{table} has both keys and a bvh file, give one")),
            (keys, None) if bvh_only => {
                let given = if keys.is_some() { "keys" } else { "no bvh file" };
                Err(format!("{table} has {given}, but joint, unit, skip_frames, yaw_deg and repeat go with bvh only"))
            }
            (Some(keys), None) => Ok(MotionSpec::Keys(keys)),
            (None, None) => Ok(MotionSpec::Still),
            (None, Some(path)) => Ok(MotionSpec::Bvh {
                path,
                joint: self.joint.ok_or_else(|| format!("{table}.joint is required with bvh"))?,
                unit: self.unit.ok_or_else(|| format!("{table}.unit is required with bvh, it is never guessed"))?,
                skip_frames: self.skip_frames.unwrap_or(0),
                yaw_deg: self.yaw_deg.unwrap_or(0.0),
                repeat: self.repeat.unwrap_or(false),
            }),
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawRecorded {
    bvh: PathBuf,
    joint: String,
    unit: LengthUnit,
    #[serde(default)]
    skip_frames: usize,
    #[serde(default)]
    yaw_deg: f64,
    seconds: f64,
    #[serde(default = "for_training")]
    used_for: MotionUse,
}

fn for_training() -> MotionUse {
    MotionUse::Train
}

impl TryFrom<RawRecorded> for RecordedSpec {
    type Error = String;

    fn try_from(raw: RawRecorded) -> Result<Self, String> {
        let RawRecorded { bvh: path, joint, unit, skip_frames, yaw_deg, seconds, used_for } = raw;
        let motion = MotionSpec::Bvh { path, joint, unit, skip_frames, yaw_deg, repeat: false };
        Ok(Self { motion, seconds, used_for })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawHead {
    builtin: Option<String>,
    radius_cm: Option<f64>,
    mesh: Option<PathBuf>,
    unit: Option<LengthUnit>,
    center: Option<bool>,
    rotate_deg: Option<[f64; 3]>,
    motion: Option<RawMotion>,
    #[serde(default)]
    pivot_cm: [f64; 3],
}

impl TryFrom<RawHead> for HeadSpec {
    type Error = String;

    fn try_from(raw: RawHead) -> Result<Self, String> {
        let mesh = mesh_source("head", raw.mesh, raw.unit, raw.center, raw.rotate_deg)?;
        if raw.radius_cm.is_some() && raw.builtin.as_deref() != Some("ball") {
            return Err("head.radius_cm goes with head.builtin = \"ball\" only".into());
        }
        let shape = match (raw.builtin.as_deref(), mesh) {
            (None | Some("head"), None) => HeadShape::Builtin,
            (Some("ball"), None) => {
                HeadShape::Ball(raw.radius_cm.ok_or("head.radius_cm is required with head.builtin = \"ball\"")?)
            }
            (None, Some(mesh)) => HeadShape::Mesh(mesh),
            (Some(_), Some(_)) => return Err("head has both a mesh and a built-in shape, give one".into()),
            (Some(other), None) => {
                return Err(format!("head.builtin is {other:?}, only \"head\" and \"ball\" exist"));
            }
        };
        let motion = raw.motion.unwrap_or_default().build("head.motion")?;
        Ok(Self { shape, motion, pivot_cm: raw.pivot_cm })
    }
}

fn mesh_source(
    table: &str,
    path: Option<PathBuf>,
    unit: Option<LengthUnit>,
    center: Option<bool>,
    rotate_deg: Option<[f64; 3]>,
) -> Result<Option<MeshSource>, String> {
    let Some(path) = path else {
        if unit.is_some() || center.is_some() || rotate_deg.is_some() {
            return Err(format!("{table} has no mesh, but unit, center and rotate_deg go with a mesh only"));
        }
        return Ok(None);
    };
    Ok(Some(MeshSource {
        path,
        unit: unit.ok_or_else(|| format!("{table}.unit is required with {table}.mesh, it is never guessed"))?,
        center: center.unwrap_or(false),
        rotate_deg: rotate_deg.unwrap_or_default(),
    }))
}

#[derive(Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
enum RawShape {
    Sphere { radius_cm: f64 },
    Rod { radius_cm: f64, length_cm: f64 },
    Comb { teeth: usize, pitch_cm: f64, tooth_radius_cm: f64, tooth_length_cm: f64, spine_radius_cm: f64 },
    Gear { teeth: usize, spokes: usize, radius_cm: f64, tooth_cm: f64, bore_cm: f64, width_cm: f64 },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawSolid {
    name: String,
    mesh: Option<PathBuf>,
    unit: Option<LengthUnit>,
    center: Option<bool>,
    rotate_deg: Option<[f64; 3]>,
    shape: Option<RawShape>,
    #[serde(default = "friction")]
    friction: f64,
    #[serde(default)]
    attach: Attach,
    keys: Option<Vec<KeySpec>>,
    motion: Option<RawMotion>,
}

impl TryFrom<RawSolid> for SolidSpec {
    type Error = String;

    fn try_from(raw: RawSolid) -> Result<Self, String> {
        let name = raw.name;
        let mesh = mesh_source(&format!("solid {name:?}"), raw.mesh, raw.unit, raw.center, raw.rotate_deg)?;
        let shape = match (mesh, raw.shape) {
            (Some(mesh), None) => SolidShape::Mesh(mesh),
            (None, Some(RawShape::Sphere { radius_cm })) => SolidShape::Sphere { radius_cm },
            (None, Some(RawShape::Rod { radius_cm, length_cm })) => SolidShape::Rod { radius_cm, length_cm },
            (None, Some(RawShape::Comb { teeth, pitch_cm, tooth_radius_cm, tooth_length_cm, spine_radius_cm })) => {
                SolidShape::Comb { teeth, pitch_cm, tooth_radius_cm, tooth_length_cm, spine_radius_cm }
            }
            (None, Some(RawShape::Gear { teeth, spokes, radius_cm, tooth_cm, bore_cm, width_cm })) => {
                SolidShape::Gear { teeth, spokes, radius_cm, tooth_cm, bore_cm, width_cm }
            }
            (Some(_), Some(_)) => return Err(format!("solid {name:?} has both a mesh and a shape, give one")),
            (None, None) => return Err(format!("solid {name:?} needs a mesh or a shape")),
        };
        let motion = match (raw.keys, raw.motion) {
            (Some(_), Some(_)) => return Err(format!("solid {name:?} has both keys and a motion, give one")),
            (Some(keys), None) => MotionSpec::Keys(keys),
            (None, motion) => motion.unwrap_or_default().build(&format!("motion of solid {name:?}"))?,
        };
        Ok(Self { name, shape, friction: raw.friction, attach: raw.attach, motion })
    }
}
