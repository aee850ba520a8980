//! Ranges of scene values, checked once so that no later stage meets a number it cannot use.
//!
//! A refusal is a pair: the field as written in the file, and what is wrong with it.

use super::{GroomSource, HeadShape, MeshSource, MotionSpec, MotionUse, Scene, SolidShape, SolidSpec};
use crate::groom::MAX_PARTICLES;
use crate::skinning_model::MAX_ELIGIBLE;

type Check = Result<(), (String, String)>;

/// Most strands and guides a scene may ask for; beyond it lies a typing error.
const MAX_STRANDS: usize = 10_000_000;
const MAX_GUIDES: usize = u16::MAX as usize;
const MAX_TEETH: usize = 1000;
const MAX_PIXELS: u32 = 16_384;
const MAX_SEQUENCES: usize = 1000;
const MAX_SECONDS: f64 = 3600.0;

pub(super) fn check(scene: &Scene) -> Check {
    if scene.name.is_empty() {
        return refuse("name", "is empty");
    }
    positive("seconds", scene.seconds)?;
    within("seconds", scene.seconds, 0.0, MAX_SECONDS)?;
    within("step_s", scene.step_s, 1e-5, 0.1)?;
    within("fps", scene.fps, 0.1, 10_000.0)?;
    check_groom(scene)?;

    match &scene.head.shape {
        HeadShape::Builtin => {}
        HeadShape::Ball(radius_cm) => positive("head.radius_cm", *radius_cm)?,
        HeadShape::Mesh(mesh) => check_mesh("head", mesh)?,
    }
    finite("head.pivot_cm", &scene.head.pivot_cm)?;
    check_motion("head.motion", &scene.head.motion)?;
    for (i, solid) in scene.solids.iter().enumerate() {
        if solid.name.is_empty() {
            return refuse(format!("solid[{i}].name"), "is empty");
        }
        if scene.solids[..i].iter().any(|s| s.name == solid.name) {
            return refuse(format!("solid[{i}].name"), format!("{:?} is taken already", solid.name));
        }
        check_solid(&format!("solid.{}", solid.name), solid)?;
    }

    let m = &scene.material;
    for (field, value) in [
        ("stretch_dyn", m.stretch_dyn),
        ("bend", m.bend),
        ("twist", m.twist),
        ("stretch_damping", m.stretch_damping),
        ("bend_damping", m.bend_damping),
        ("twist_damping", m.twist_damping),
        ("friction", m.friction),
        ("air_drag_per_s", m.air_drag_per_s),
    ] {
        within(format!("material.{field}"), value.unwrap_or(0.0), 0.0, f64::MAX)?;
    }
    positive("material.linear_density_g_per_cm", m.linear_density_g_per_cm.unwrap_or(1.0))?;

    let t = &scene.train;
    let trains = t.recorded.iter().any(|r| r.used_for == MotionUse::Train);
    count("train.sequences", t.sequences, usize::from(!trains), MAX_SEQUENCES)?;
    positive("train.seconds_per_sequence", t.seconds_per_sequence)?;
    within("train.seconds_per_sequence", t.seconds_per_sequence, 0.0, MAX_SECONDS)?;
    within("train.fps", t.fps, 0.1, 10_000.0)?;
    positive("train.sparsity", t.sparsity)?;
    within("train.min_weight", t.min_weight, 0.0, 1.0)?;
    within("train.validation_seconds", t.validation_seconds, 0.0, MAX_SECONDS)?;
    within("train.held_out_seconds", t.held_out_seconds, 0.0, MAX_SECONDS)?;
    for recorded in &t.recorded {
        positive("train.recorded.seconds", recorded.seconds)?;
        within("train.recorded.seconds", recorded.seconds, 0.0, MAX_SECONDS)?;
    }

    let c = &scene.camera;
    finite("camera.eye_cm", &c.eye_cm)?;
    finite("camera.target_cm", &c.target_cm)?;
    if c.eye_cm == c.target_cm {
        return refuse("camera.target_cm", "is where the eye is");
    }
    within("camera.vertical_fov_deg", c.vertical_fov_deg, 1.0, 170.0)?;
    count("camera.width", c.width as usize, 1, MAX_PIXELS as usize)?;
    count("camera.height", c.height as usize, 1, MAX_PIXELS as usize)
}

fn check_groom(scene: &Scene) -> Check {
    let g = &scene.groom;
    match &g.source {
        GroomSource::File { path, translate_cm, .. } => {
            if path.as_os_str().is_empty() {
                return refuse("groom.file", "is empty");
            }
            finite("groom.translate_cm", translate_cm)?;
        }
        GroomSource::Generated(generator) => {
            count("groom.generator.strands", generator.strands, 1, MAX_STRANDS)?;
            within("groom.generator.length_cm", generator.length_cm, 0.1, 1000.0)?;
            if g.guides > generator.strands {
                return refuse("groom.guides", format!("{} guides of {} strands", g.guides, generator.strands));
            }
        }
    }
    // Four particles make the shortest strand with a torsion spring.
    if let Some(n) = g.densify_to {
        count("groom.densify_to", n, 1, MAX_STRANDS)?;
        if g.guides > n {
            return refuse("groom.guides", format!("{} guides of {n} strands", g.guides));
        }
    }
    count("groom.particles", g.particles, 4, MAX_PARTICLES)?;
    count("groom.guides", g.guides, 1, MAX_GUIDES)?;
    count("groom.max_eligible", g.max_eligible, 1, MAX_ELIGIBLE)
}

fn check_solid(at: &str, solid: &SolidSpec) -> Check {
    within(format!("{at}.friction"), solid.friction, 0.0, 100.0)?;
    check_motion(at, &solid.motion)?;
    match solid.shape {
        SolidShape::Mesh(ref mesh) => check_mesh(at, mesh),
        SolidShape::Sphere { radius_cm } => positive(format!("{at}.shape.radius_cm"), radius_cm),
        SolidShape::Rod { radius_cm, length_cm } => {
            positive(format!("{at}.shape.radius_cm"), radius_cm)?;
            positive(format!("{at}.shape.length_cm"), length_cm)
        }
        SolidShape::Comb { teeth, pitch_cm, tooth_radius_cm, tooth_length_cm, spine_radius_cm } => {
            count(format!("{at}.shape.teeth"), teeth, 1, MAX_TEETH)?;
            positive(format!("{at}.shape.pitch_cm"), pitch_cm)?;
            positive(format!("{at}.shape.tooth_radius_cm"), tooth_radius_cm)?;
            positive(format!("{at}.shape.tooth_length_cm"), tooth_length_cm)?;
            positive(format!("{at}.shape.spine_radius_cm"), spine_radius_cm)?;
            if teeth > 1 && pitch_cm <= 2.0 * tooth_radius_cm {
                let why = format!("{pitch_cm} leaves no gap between teeth of radius {tooth_radius_cm}");
                return refuse(format!("{at}.shape.pitch_cm"), why);
            }
            Ok(())
        }
        SolidShape::Gear { teeth, spokes, radius_cm, tooth_cm, bore_cm, width_cm } => {
            count(format!("{at}.shape.teeth"), teeth, 3, MAX_TEETH)?;
            count(format!("{at}.shape.spokes"), spokes, 2, MAX_TEETH)?;
            for (name, value) in
                [("radius_cm", radius_cm), ("tooth_cm", tooth_cm), ("bore_cm", bore_cm), ("width_cm", width_cm)]
            {
                positive(format!("{at}.shape.{name}"), value)?;
            }
            Ok(())
        }
    }
}

fn check_mesh(at: &str, mesh: &MeshSource) -> Check {
    if mesh.path.as_os_str().is_empty() {
        return refuse(format!("{at}.mesh"), "is empty");
    }
    finite(format!("{at}.rotate_deg"), &mesh.rotate_deg)
}

fn check_motion(at: &str, motion: &MotionSpec) -> Check {
    match motion {
        MotionSpec::Still => Ok(()),
        MotionSpec::Bvh { path, .. } if path.as_os_str().is_empty() => refuse(format!("{at}.bvh"), "is empty"),
        MotionSpec::Bvh { yaw_deg, .. } => finite(format!("{at}.yaw_deg"), &[*yaw_deg]),
        MotionSpec::Keys(keys) => {
            if keys.is_empty() {
                return refuse(format!("{at}.keys"), "is empty; leave it out for a body at rest");
            }
            for (i, key) in keys.iter().enumerate() {
                finite(format!("{at}.keys[{i}].t"), &[key.t])?;
                finite(format!("{at}.keys[{i}].translate_cm"), &key.translate_cm)?;
                finite(format!("{at}.keys[{i}].rotate_deg"), &key.rotate_deg)?;
                if i > 0 && key.t <= keys[i - 1].t {
                    let why = format!("{} does not come after {}; sort the keys by time", key.t, keys[i - 1].t);
                    return refuse(format!("{at}.keys[{i}].t"), why);
                }
            }
            Ok(())
        }
    }
}

fn refuse(field: impl Into<String>, reason: impl Into<String>) -> Check {
    Err((field.into(), reason.into()))
}

fn finite(field: impl Into<String>, values: &[f64]) -> Check {
    match values.iter().find(|x| !x.is_finite()) {
        Some(x) => refuse(field, format!("{x} is not a finite number")),
        None => Ok(()),
    }
}

fn positive(field: impl Into<String>, value: f64) -> Check {
    if value.is_finite() && value > 0.0 { Ok(()) } else { refuse(field, format!("{value} is not a positive number")) }
}

/// `low <= value <= high`, which a value that is not a number fails.
fn within(field: impl Into<String>, value: f64, low: f64, high: f64) -> Check {
    if low <= value && value <= high {
        Ok(())
    } else {
        refuse(field, format!("{value} is not within {low} to {high:e}"))
    }
}

fn count(field: impl Into<String>, value: usize, low: usize, high: usize) -> Check {
    if (low..=high).contains(&value) { Ok(()) } else { refuse(field, format!("{value} is not within {low} to {high}")) }
}
