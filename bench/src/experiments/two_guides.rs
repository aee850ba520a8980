//! Two normal hairs, two guides and one rod: the paper's drawing of why sets must change (AS16 Fig. 4, §3.2), as a constructed case.
//!
//! The model is made by hand: strands in a row along x, each normal hair between both guides, with both or either of them as its
//! set. A rod comes between the normal hairs, first one that the guides meet as well, then one too short to reach them.

use super::watch::{Row, Watched, reference, side_by_side, watch_each};
use super::words::{CLEAN_PCT, VISIBLE_PCT, claim, lower, table, verdict};
use crate::error::Error;
use crate::evidence::{Experiment, Findings, Place, Table, number, text};
use crate::runtime_bench::Subject;
use crate::world::World;
use adaptive_runtime::{Correction, RuntimeParams, record_of};
use io_formats::groom::UniformGroom;
use io_formats::guide_transform::Blend;
use io_formats::scene::{CameraSpec, Scene};
use io_formats::skinning_model::{SkinningModel, WeightPoly};
use std::path::Path;
use strand_sim::Material;

/// The experiment.
pub const EXPERIMENT: Experiment =
    Experiment {
        name: "two-guides", title: "Two hairs, two guides, one rod", source: "AS16 §3.2, Fig. 4; §5.2", run
    };

/// Particles of a strand.
const N: usize = 25;
/// Length of a strand, cm.
const LENGTH_CM: f32 = 18.0;
/// Where strands hang along x, cm: guide, two hairs, guide.
const ROW: [f32; 4] = [-1.2, -0.35, 0.35, 1.2];
const GUIDES: [u32; 2] = [0, 3];
/// Moments drawn, s.
const MOMENTS: [f64; 2] = [0.7, 1.4];

/// A rod along z that comes from the side, and one that stands between the hairs and pushes both apart from in front. Between
/// guides lies the gap it comes through. Poses: through the row from in front, then to the side.
const SPLIT: &str = r#"
[[solid]]
name = "rod"
shape = { kind = "rod", radius_cm = 0.2, length_cm = 6 }
friction = 0.1
keys = [
  { t = 0.0, translate_cm = [0.0, -11.0, 6.0], rotate_deg = [90, 0, 0] },
  { t = 0.4, translate_cm = [0.0, -11.0, 0.0], rotate_deg = [90, 0, 0] },
  { t = 1.2, translate_cm = [3.5, -11.0, 0.0], rotate_deg = [90, 0, 0] },
]
"#;

/// A short rod across the two hairs, that pushes them back and ends before the guides.
const PUSH: &str = r#"
[[solid]]
name = "rod"
shape = { kind = "rod", radius_cm = 0.2, length_cm = 1.0 }
friction = 0.1
keys = [
  { t = 0.0, translate_cm = [0.0, -11.0, 4.0], rotate_deg = [0, 0, 90] },
  { t = 0.4, translate_cm = [0.0, -11.0, 1.2], rotate_deg = [0, 0, 90] },
  { t = 1.2, translate_cm = [0.0, -11.0, -2.5], rotate_deg = [0, 0, 90] },
]
"#;

fn shape(x: f32) -> Vec<[f32; 3]> {
    (0..N).map(|i| [x, -1.5 - LENGTH_CM * i as f32 / (N - 1) as f32, 0.0]).collect()
}

/// Hair in a row along x, the strands in `guides` guides. Every other hair may follow all guides or any of them, the nearer with
/// the larger weight.
pub(super) fn model(x: &[f32], guides: &[u32]) -> SkinningModel {
    let n_guides = guides.len();
    let at = |g: usize| x[guides[g] as usize];
    let mut out = SkinningModel {
        provenance: 4,
        n_strands: x.len() as u32,
        n_particles: N as u32,
        groom_in_head: (0..n_guides).flat_map(|g| shape(at(g))).flatten().collect(),
        rest_in_head: x.iter().flat_map(|&x| shape(x)).flatten().collect(),
        guide_strands: guides.to_vec(),
        eligible_start: vec![0],
        eligible: Vec::new(),
        set_start: vec![0],
        set_mask: Vec::new(),
        set_rms_error_cm: Vec::new(),
        coeff_start: Vec::new(),
        coeffs: Vec::new(),
        stand_in_start: vec![0],
        stand_in: Vec::new(),
        pairs: Vec::new(),
        position_scale: Vec::new(),
        velocity_scale: Vec::new(),
        velocity_weight: 5.0,
        max_distance: 4.0,
        release_distance: 6.0,
        blend: Blend::Rigid,
        material: record_of(&Material::straight()),
    };
    for (s, &x) in x.iter().enumerate() {
        let own = guides.iter().position(|&g| g as usize == s);
        let eligible: Vec<usize> = own.map_or_else(|| (0..n_guides).collect(), |g| vec![g]);
        out.eligible.extend(eligible.iter().map(|&g| g as u16));
        for mask in 1..1_u16 << eligible.len() {
            let members = || (0..eligible.len()).filter(|b| mask >> b & 1 == 1).map(|b| eligible[b]);
            let near = |g: usize| 1.0 / (at(g) - x).abs().max(0.01);
            let sum: f32 = members().map(near).sum();
            out.set_mask.push(mask);
            out.set_rms_error_cm.push(0.1 / members().count() as f32);
            out.coeff_start.push(out.coeffs.len() as u32);
            out.coeffs.extend(members().map(|g| WeightPoly { quad: 0.0, lin: 0.0, con: near(g) / sum }.to_bits()));
            out.stand_in.push(mask - 1);
        }
        out.eligible_start.push(out.eligible.len() as u32);
        out.set_start.push(out.set_mask.len() as u32);
        out.stand_in_start.push(out.stand_in.len() as u32);
    }
    for i in 0..n_guides {
        for j in i + 1..n_guides {
            out.pairs.push([i as u16, j as u16]);
            // At rest a pair is at distance one; a metre a second apart counts as much.
            out.position_scale.push(N as f32 * (at(i) - at(j)).powi(2));
            out.velocity_scale.push(N as f32 * 1e4);
        }
    }
    out
}

/// The row below a ball too small to meet it, among a solid.
fn world(name: &str, solid: &str) -> Result<World, Error> {
    let text = format!(
        "name = \"{name}\"\nseconds = 1.6\n[groom]\ngenerator = {{ style = \"straight\", strands = 4, length_cm = 18 }}\n\
         particles = 25\nguides = 2\n[head]\nbuiltin = \"ball\"\nradius_cm = 1.0\n{solid}"
    );
    let mut scene = Scene::from_toml(&text, Path::new(""))?;
    scene.camera = CameraSpec {
        eye_cm: [-12.0, -8.0, 30.0],
        target_cm: [0.3, -10.5, 0.0],
        vertical_fov_deg: 38.0,
        width: 480,
        height: 640,
    };
    let mut world = World::build(scene, |_| {})?;
    world.groom = UniformGroom { n_strands: 4, n_particles: N, points: ROW.iter().flat_map(|&x| shape(x)).collect() };
    Ok(world)
}

fn run(place: &dyn Place) -> Result<Findings, Error> {
    let model = model(&ROW, &GUIDES);
    let mut out = Findings {
        paragraphs: vec![
            "Two hairs hang between two guides. In the first case a rod comes between the hairs and pulls one guide aside: with a \
             fixed set both hairs follow the mean of both guides, across the rod; when sets change, each keeps to the guide on its own \
             side. In the second case a short rod pushes back the two hairs and ends before it reaches the guides, which know \
             of it only by the forces that hairs hand on to them (AS16 Eq. 4). Strands drawn red are inside the rod."
                .to_owned(),
        ],
        ..Findings::default()
    };
    let split = case(place, &model, "split", SPLIT, &mut out)?;
    let push = case(place, &model, "push", PUSH, &mut out)?;
    let inside = |(way, _): &(Watched, f64)| way.quality.measured.near_strands_inside_pct;
    out.claims.push(claim(
        "AS16 §3.2, Fig. 4 (d-f)",
        "With fixed sets normal hairs take unnatural shapes and intersect the solid that splits their guides.",
        "drawn",
        format!("{:.1} % of hairs in reach inside", inside(&split[1])),
        verdict(&[inside(&split[1]) >= VISIBLE_PCT]),
        "",
    ));
    out.claims.push(claim(
        "AS16 §3.2, Fig. 4 (a-c)",
        "With guides chosen adaptively the same hairs move correctly.",
        "drawn",
        format!(
            "{:.2} % inside; error of near hairs {:.2} % of length, {:.2} % with fixed sets",
            inside(&split[0]),
            split[0].0.error_pct()[0],
            split[1].0.error_pct()[0]
        ),
        verdict(&[inside(&split[0]) <= CLEAN_PCT, split[0].0.error_pct()[0] < split[1].0.error_pct()[0]]),
        "",
    ));
    let [ours, fixed, alone] = [0, 1, 2].map(|k| push[k].1);
    out.claims.push(claim(
        "AS16 §5.2",
        "Forces on normal hairs move the guides that they follow, which do not touch the solid themselves.",
        "stated",
        format!(
            "guides moved by {ours:.2} cm with two-way forces, {alone:.2} cm without, {fixed:.2} cm with fixed sets"
        ),
        verdict(&[ours > 2.0 * alone.max(0.01), inside(&push[0]) <= CLEAN_PCT]),
        "",
    ));
    out.measures = vec![
        lower("inside_pct_split", "%", inside(&split[0]), 1.0),
        lower("inside_pct_push", "%", inside(&push[0]), 1.0),
        lower("error_near_pct_split", "% of length", split[0].0.error_pct()[0], 1.0),
    ];
    Ok(out)
}

/// Ours, fixed sets and the others in one case, each with how far its guides went from where they hung, at most, cm.
fn case(
    place: &dyn Place,
    model: &SkinningModel,
    name: &str,
    solid: &str,
    out: &mut Findings,
) -> Result<Vec<(Watched, f64)>, Error> {
    let world = world(name, solid)?;
    let forces = |two_way, correction| {
        let mut params = RuntimeParams::adaptive();
        params.two_way.enabled = two_way;
        params.residual.correction = correction;
        params
    };
    let ways = [
        ("ours", RuntimeParams::adaptive()),
        ("fixed sets", RuntimeParams::fixed()),
        ("ours without two-way", forces(false, Correction::Carried)),
        ("sets and two-way forces only", forces(true, Correction::None)),
        ("sets only", forces(false, Correction::None)),
    ];
    let subject = Subject { world: &world, model, params: RuntimeParams::adaptive() };
    let against = reference(place, &subject, ROW.len(), ROW.len(), &MOMENTS)?;
    let mut found = Vec::new();
    for (_, params) in &ways {
        let mut moved: f64 = 0.0;
        let mut start: Option<Vec<[f32; 3]>> = None;
        let subject = Subject { params: *params, ..subject };
        let way = watch_each(place, &subject, &against, &MOMENTS, |_, runtime| {
            let guides = runtime.guides_in_head();
            let start = start.get_or_insert_with(|| guides.to_vec());
            let far =
                |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum::<f64>().sqrt();
            moved = guides.iter().zip(start.iter()).map(far).fold(moved, f64::max);
        })?;
        found.push((way, moved));
    }
    let named: Vec<(&str, &Watched)> = ways.iter().zip(&found).map(|((name, _), (way, _))| (*name, way)).collect();
    out.tables.push(table(&format!("Case {name}: two hairs, two guides, one rod"), &against, &named));
    out.tables.push(Table {
        title: format!("Case {name}: largest way of a guide particle"),
        columns: ["way", "cm"].map(str::to_owned).to_vec(),
        rows: named.iter().zip(&found).map(|((name, _), (_, moved))| vec![text(*name), number(*moved, 2)]).collect(),
        note: String::new(),
    });
    for (at, t) in MOMENTS.into_iter().enumerate() {
        let mut shown = vec![("full space", against.shots[at].as_slice())];
        shown.extend(named.iter().map(|(name, way)| (*name, way.shots[at].as_slice())));
        let row = format!("two-guides-{name}-{at}");
        out.pictures.extend(side_by_side(
            place,
            &world,
            Row { name: &row, t, n_strands: ROW.len(), marks: true },
            &shown,
        )?);
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_model_made_by_hand_is_valid_and_hangs_clear_of_its_head_and_rods() {
        let model = model(&ROW, &GUIDES);
        model.validate().expect("a sound model");
        for (name, solid) in [("split", SPLIT), ("push", PUSH)] {
            let world = world(name, solid).expect("a world");
            let solids = world.moving_solids(0.0, 0.01);
            let rest: Vec<[f32; 3]> = ROW.iter().flat_map(|&x| shape(x)).collect();
            assert!(crate::measures::in_reach(&rest, &rest, N, &solids).is_empty(), "{name}");
            assert!(crate::measures::in_reach(&rest, &rest, N, &[world.moving_head(0.0, 0.01)]).is_empty());
        }
    }
}
