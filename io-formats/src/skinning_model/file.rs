//! The bytes of a skinning model, as docs/MODEL_FORMAT.md lays them out: numbers first, then arrays one after the other.
//!
//! An array is its number of entries (`u64`), the entries, little-endian, and zeros up to a multiple of eight bytes, so
//! that every array of the payload begins at one. Where the sets' triples begin follows from their masks and is not in the
//! file. Each array is read into its place and hashed on the way; every count is compared with what is left of the file before
//! anything is allocated.

use std::path::Path;

use bytemuck::{Pod, cast_slice, cast_slice_mut};

use super::{MaterialRecord, SkinningModel, VERSION};
use crate::envelope::{Kind, PayloadReader};
use crate::error::{Error, Result};
use crate::guide_transform::Blend;

/// Arrays begin at multiples of this.
const ALIGNMENT: usize = 8;

fn put<T: Pod>(out: &mut Vec<u8>, values: &[T]) {
    out.extend_from_slice(&(values.len() as u64).to_le_bytes());
    out.extend_from_slice(cast_slice(values));
    out.resize(out.len().next_multiple_of(ALIGNMENT), 0);
}

fn get<T: Pod>(reader: &mut PayloadReader<'_>, field: &'static str) -> Result<Vec<T>> {
    let count = u64::from_le_bytes(reader.number(field)?);
    reader.expect(count, size_of::<T>(), field)?;
    let mut values = vec![T::zeroed(); count as usize];
    reader.fill(cast_slice_mut(&mut values), field)?;
    let at = reader.offset();
    let mut padding = [0; ALIGNMENT];
    let padding = &mut padding[..(at.next_multiple_of(ALIGNMENT as u64) - at) as usize];
    reader.fill(padding, field)?;
    if padding.iter().any(|&b| b != 0) {
        return Err(reader.bad(field, at, "is followed by bytes that are not zero".into()));
    }
    Ok(values)
}

/// The payload of a model's file.
pub(super) fn to_bytes(model: &SkinningModel) -> Vec<u8> {
    let mut out = Vec::with_capacity(4 * model.rest_in_head.len() + 6 * model.coeffs.len() + (1 << 20));
    out.extend_from_slice(&model.provenance.to_le_bytes());
    for x in [model.n_strands, model.n_particles] {
        out.extend_from_slice(&x.to_le_bytes());
    }
    for x in [model.velocity_weight, model.max_distance, model.release_distance] {
        out.extend_from_slice(&x.to_le_bytes());
    }
    let blend: u32 = match model.blend {
        Blend::Translation => 0,
        Blend::Rigid => 1,
    };
    out.extend_from_slice(&blend.to_le_bytes());
    out.extend_from_slice(cast_slice(&model.material.constants()));
    put(&mut out, &model.groom_in_head);
    put(&mut out, &model.rest_in_head);
    put(&mut out, &model.guide_strands);
    put(&mut out, &model.eligible_start);
    put(&mut out, &model.eligible);
    put(&mut out, &model.set_start);
    put(&mut out, &model.set_mask);
    put(&mut out, &model.set_rms_error_cm);
    put(&mut out, &model.coeffs);
    put(&mut out, &model.stand_in_start);
    put(&mut out, &model.stand_in);
    put(&mut out, &model.pairs);
    put(&mut out, &model.position_scale);
    put(&mut out, &model.velocity_scale);
    out
}

/// A model from its file; its invariants are still to be checked.
pub(super) fn read(path: &Path) -> Result<SkinningModel> {
    let mut reader = PayloadReader::open(path, Kind::SKINNING_MODEL, VERSION)?;
    let model = read_payload(&mut reader);
    match reader.finish() {
        // Of damaged bytes nothing else is worth saying.
        Err(damaged @ Error::Checksum { .. }) => Err(damaged),
        Err(left_over) => model.and(Err(left_over)),
        Ok(()) => model,
    }
}

fn read_payload(r: &mut PayloadReader<'_>) -> Result<SkinningModel> {
    let provenance = u64::from_le_bytes(r.number("provenance")?);
    let n_strands = u32::from_le_bytes(r.number("n_strands")?);
    let n_particles = u32::from_le_bytes(r.number("n_particles")?);
    let velocity_weight = f32::from_le_bytes(r.number("velocity_weight")?);
    let max_distance = f32::from_le_bytes(r.number("max_distance")?);
    let release_distance = f32::from_le_bytes(r.number("release_distance")?);
    let at = r.offset();
    let blend = match u32::from_le_bytes(r.number("blend")?) {
        0 => Blend::Translation,
        1 => Blend::Rigid,
        other => return Err(r.bad("blend", at, format!("is {other}; 0 is translation, 1 rigid"))),
    };
    let mut constants = [0.0; 9];
    for x in &mut constants {
        *x = f64::from_le_bytes(r.number("material")?);
    }
    let [stretch_dyn, bend, twist, stretch_damping, bend_damping, twist_damping, friction, density, drag] = constants;
    let mut model = SkinningModel {
        provenance,
        n_strands,
        n_particles,
        groom_in_head: get(r, "groom_in_head")?,
        rest_in_head: get(r, "rest_in_head")?,
        guide_strands: get(r, "guide_strands")?,
        eligible_start: get(r, "eligible_start")?,
        eligible: get(r, "eligible")?,
        set_start: get(r, "set_start")?,
        set_mask: get(r, "set_mask")?,
        set_rms_error_cm: get(r, "set_rms_error_cm")?,
        coeff_start: Vec::new(),
        coeffs: get(r, "coeffs")?,
        stand_in_start: get(r, "stand_in_start")?,
        stand_in: get(r, "stand_in")?,
        pairs: get(r, "pairs")?,
        position_scale: get(r, "position_scale")?,
        velocity_scale: get(r, "velocity_scale")?,
        velocity_weight,
        max_distance,
        release_distance,
        blend,
        material: MaterialRecord {
            stretch_dyn,
            bend,
            twist,
            stretch_damping,
            bend_damping,
            twist_damping,
            friction,
            linear_density_g_per_cm: density,
            air_drag_per_s: drag,
        },
    };
    model.coeff_start = starts_of(&model.set_mask);
    Ok(model)
}

/// Where each set's triples begin: as many as all masks before have bits. A sum beyond `u32` wraps; a model of so many
/// triples does not pass validation.
fn starts_of(masks: &[u16]) -> Vec<u32> {
    let mut at = 0_u32;
    masks
        .iter()
        .map(|mask| {
            let start = at;
            at = at.wrapping_add(mask.count_ones());
            start
        })
        .collect()
}
