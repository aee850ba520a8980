//! The paper's tests of single hairs and of a tuft (MS08 Fig. 10, 11 and 13), from [`crate::strand_scenes`].

use super::words::{claim, lower, verdict};
use crate::error::Error;
use crate::evidence::{Experiment, Findings, Place, Size, Table, number, text};
use crate::strand_scenes::basic::BasicParams;
use crate::strand_scenes::buckling::{ClampedHair, critical_twist, push_into_loop};
use crate::strand_scenes::crossing::pull_across;
use crate::strand_scenes::curls::{Curl, drop_curls, hang_wavy, stretch_and_release};
use crate::strand_scenes::tuft::{Tuft, TuftFigures, TuftModel, shake};
use strand_sim::interaction::StictionParams;
use strand_sim::{InteractionParams, Material};

/// The experiment.
pub const EXPERIMENT: Experiment = Experiment {
    name: "single-hairs",
    title: "Single hairs and a tuft",
    source: "MS08 §3, §4.2, §5, Fig. 10, 11, 13",
    run,
};

/// Seconds a tuft is shaken.
const SHAKEN_S: f64 = 1.5;

fn run(place: &dyn Place) -> Result<Findings, Error> {
    const PARTS: usize = 6;
    let mut out = Findings {
        paragraphs: vec![
            "The tests of one hair at a time: buckling under a push, twisting until it gives way, sticking to another hair, a curl stretched \
             and released, curls of different stiffness dropped, hair of every waviness hung; and a shaken tuft in three models."
                .to_owned(),
        ],
        ..Findings::default()
    };
    let mut rows = Vec::new();
    let mut add = |what: &str, value: f64, digits: u8, unit: &str| {
        rows.push(vec![text(what), number(value, digits), text(unit)]);
    };
    // Fig. 10 (a) and (b): what a straight hair does under a push and a twist.
    let (pushed, _) = push_into_loop(&ClampedHair::standard(), 0.7, 0.0, 0.1)?;
    add("pushed together by 0.7 of its length: off its axis", pushed.off_axis_share, 3, "of length");
    add("the same: largest strain", pushed.largest_strain, 4, "");
    place.progress("single hairs", 1, PARTS);
    out.claims.push(claim(
        "MS08 Fig. 10 (a)",
        "A hair forced together at its ends buckles into a loop.",
        "shown in pictures",
        format!(
            "{:.2} of its length off the axis, turned by {:.1} rad at most between segments",
            pushed.off_axis_share, pushed.largest_turn
        ),
        verdict(&[pushed.off_axis_share > 0.1, pushed.largest_strain < 0.1]),
        "",
    ));
    if place.size() != Size::Smoke {
        let critical = critical_twist(&ClampedHair { n_particles: 81, ..ClampedHair::standard() }, 0.005, 0.1)?;
        add("twist at which a straight hair snaps sideways", critical.turns, 2, "turns");
        add("the same of a rod of its stiffness", critical.rod_turns, 2, "turns");
        out.claims.push(claim(
            "MS08 Fig. 10 (b)",
            "A hair twisted at one end gives way and tangles.",
            "shown in pictures",
            format!(
                "snaps at {:.2} turns; an elastic rod of its stiffness at {:.2}",
                critical.turns, critical.rod_turns
            ),
            verdict(&[critical.turns > 0.0, (critical.turns / critical.rod_turns - 1.0).abs() < 0.2]),
            "Held to the theory of rods, which the paper does not do.",
        ));
    }
    place.progress("single hairs", 2, PARTS);
    let (dry, _) = pull_across(Material::straight(), StictionParams::dry(), 5.0)?;
    let (off, _) = pull_across(Material::straight(), StictionParams::off(), 5.0)?;
    add("pulled across another, dry: other hair dragged along by", dry.dragged_cm, 3, "cm");
    add("the same without stiction", off.dragged_cm, 3, "cm");
    place.progress("single hairs", 3, PARTS);
    out.claims.push(claim(
        "MS08 §5.2, Fig. 10 (c)",
        "A hair pulled across another sticks to it and lets go suddenly.",
        "shown in pictures",
        format!(
            "dragged along by {:.2} cm, {:.2} cm without stiction; broke {}",
            dry.dragged_cm,
            off.dragged_cm,
            dry.broke_s.map_or_else(|| "never".to_owned(), |t| format!("after {t:.2} s"))
        ),
        verdict(&[dry.dragged_cm > 2.0 * off.dragged_cm, dry.broke_s.is_some()]),
        "",
    ));
    let (stretched, _) = stretch_and_release(&Curl::standard(), Material::curly(), 1.6)?;
    let (dropped, _) = drop_curls(&Curl::standard(), Material::wavy(), &[0.25, 1.0, 4.0])?;
    add("curl stretched to", stretched.stretched, 2, "x its height");
    add("the same released: overshoot", stretched.overshoot, 3, "of height");
    for (factor, extension) in dropped.stiffness.iter().zip(&dropped.extension) {
        add(&format!("curl of {factor} x the stiffness, hanging"), *extension, 2, "x its height at rest");
    }
    place.progress("single hairs", 4, PARTS);
    let softer = dropped.extension.windows(2).all(|w| w[0] > w[1]);
    out.claims.push(claim(
        "MS08 Fig. 11, top",
        "Curls of different stiffness extend differently when dropped: different types of curly hair can be had.",
        "shown in pictures",
        dropped.extension.iter().map(|e| format!("{e:.2}")).collect::<Vec<_>>().join(", ") + " x height, soft to stiff",
        verdict(&[softer]),
        "",
    ));
    let (waves, _) = hang_wavy(Material::curly())?;
    for (name, kept) in ["straight", "wavy", "evenly wavy", "curly"].iter().zip(waves.kept) {
        add(&format!("waviness kept when hanging, {name}"), kept, 3, "");
    }
    place.progress("single hairs", 5, PARTS);
    out.claims.push(claim(
        "MS08 Fig. 11, bottom",
        "The model handles the whole spectrum of curliness.",
        "shown in pictures",
        format!("share of waviness kept when hanging: {}", waves.kept.map(|k| format!("{k:.2}")).join(", ")),
        verdict(&[waves.kept.iter().all(|&k| k > 0.5)]),
        "",
    ));
    out.tables.push(Table {
        title: "Single hairs".to_owned(),
        columns: ["test", "value", "unit"].map(str::to_owned).to_vec(),
        rows,
        note: String::new(),
    });
    tuft(place.size(), &mut out)?;
    place.progress("single hairs", PARTS, PARTS);
    Ok(out)
}

fn tuft(size: Size, out: &mut Findings) -> Result<(), Error> {
    let standard = Tuft::standard();
    let n_strands = match size {
        Size::Smoke => standard.n_strands / 4,
        Size::Quick => standard.n_strands / 2,
        Size::Full => standard.n_strands,
    };
    let tuft = Tuft { n_strands, ..standard };
    let models = [
        ("basic mass/spring", TuftModel::Basic(BasicParams::paper())),
        ("full", TuftModel::Full(None)),
        ("full, hair meets hair", TuftModel::Full(Some(InteractionParams::dry()))),
    ];
    let mut found: Vec<(&str, TuftFigures)> = Vec::new();
    for (name, model) in models {
        found.push((name, shake(&tuft, model, SHAKEN_S)?.0));
    }
    let columns =
        ["model", "largest strain", "strain, 99 %", "pairs that went through each other", "links", "spread, cm"];
    out.tables.push(Table {
        title: format!("A shaken tuft of {} hairs", tuft.n_strands),
        columns: columns.map(str::to_owned).to_vec(),
        rows: found
            .iter()
            .map(|(name, f)| {
                vec![
                    text(*name),
                    number(f.largest_strain, 3),
                    number(f.p99_strain, 4),
                    number(f.unlinked_passes as f64, 0),
                    number(f.links, 0),
                    number(f.spread_cm, 2),
                ]
            })
            .collect(),
        note: String::new(),
    });
    let [basic, full, meeting] = [0, 1, 2].map(|k| found[k].1);
    out.claims.push(claim(
        "MS08 §4.2, Fig. 13 (a, b)",
        "A basic mass/spring model stretches severely under head motion; altitude springs, implicit springs and strain limiting keep hair's length.",
        "shown in pictures",
        format!("largest strain {:.2} basic, {:.3} full", basic.largest_strain, full.largest_strain),
        verdict(&[basic.largest_strain > 0.1, full.largest_strain < 0.1]),
        "",
    ));
    out.claims.push(claim(
        "MS08 §5, Fig. 13 (c)",
        "With stiction and self-collisions a tuft looks much more realistic.",
        "shown in pictures",
        format!(
            "{} pairs went through each other, {} without; {:.0} links hold hairs together; spread {:.2} cm, {:.2} cm without",
            meeting.unlinked_passes, full.unlinked_passes, meeting.links, meeting.spread_cm, full.spread_cm
        ),
        verdict(&[10 * meeting.unlinked_passes <= full.unlinked_passes, meeting.links > 0.0]),
        "Realism is not measured; that hairs no longer go through each other and clump is.",
    ));
    out.measures.push(lower("largest_strain_full", "", full.largest_strain, 0.02));
    out.measures.push(lower("passes_meeting", "pairs", meeting.unlinked_passes as f64, 20.0));
    Ok(())
}
