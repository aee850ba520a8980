//! How far a spring network is from the rod it stands for: cantilever, swing, twist and coil against the fixtures.
//!
//! Prints one CSV table for each; README.md beside it says what was found. Name one of them as the argument to see it alone.

#![allow(clippy::print_stdout, reason = "a program whose output is its table")]

mod rods;

use rods::{Clamp, Coil, CoilSprings, DENSITY, EI, GJ, GRAVITY, Springs};
use strand_sim::Scheme;

fn fixture(name: &str) -> Result<serde_json::Value, Box<dyn std::error::Error>> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/rods").join(name);
    Ok(serde_json::from_str(&std::fs::read_to_string(path)?)?)
}

fn cantilever() -> Result<(), Box<dyn std::error::Error>> {
    println!("cantilever: length_cm,springs,clamp,particles,tip_error_over_length,order");
    for case in fixture("cantilever.json")?["cases"].as_array().ok_or("no cases")? {
        let length = case["length"].as_f64().ok_or("no length")?;
        let tip: Vec<f64> = serde_json::from_value(case["elastica_xz"][20].clone())?;
        for (springs, clamp) in [
            (Springs::Calibrated, Clamp::MidSegment),
            (Springs::Calibrated, Clamp::AtRoot),
            (Springs::Naive, Clamp::MidSegment),
        ] {
            let mut last = f64::NAN;
            for n in [10, 20, 40, 80] {
                let [x, z] = rods::cantilever_tip(length, n, springs, clamp)?;
                let error = (x - tip[0]).hypot(z - tip[1]) / length;
                let order = (last / error).log2();
                println!("{length},{springs:?},{clamp:?},{n},{error:.3e},{order:.2}");
                last = error;
            }
        }
    }
    Ok(())
}

fn swing() -> Result<(), Box<dyn std::error::Error>> {
    let length = 4.0;
    let omega = rods::small_frequency(length);
    let theory = std::f64::consts::TAU / omega;
    println!("small swing: scheme,particles,dt_ms,period_error,decay_per_s,half_omega2_dt");
    for (scheme, n, dt) in [
        (Scheme::BackwardEuler, 10, 1e-4),
        (Scheme::BackwardEuler, 20, 1e-4),
        (Scheme::BackwardEuler, 40, 1e-4),
        (Scheme::BackwardEuler, 40, 5e-5),
        (Scheme::BackwardEuler, 20, 1e-3),
        (Scheme::BackwardEuler, 20, 5e-4),
        (Scheme::TwoSolves, 20, 5e-4),
        (Scheme::Trapezoidal, 20, 5e-4),
        (Scheme::Trapezoidal, 20, 1e-4),
    ] {
        let [period, decay] = rods::small_swing(length, n, dt, scheme)?;
        let expected = 0.5 * omega * omega * dt;
        println!("{scheme:?},{n},{},{:.3e},{decay:.4},{expected:.4}", 1e3 * dt, period / theory - 1.0);
    }
    let reference: Vec<[f64; 2]> = serde_json::from_value(fixture("swing.json")?["tip_xz_n64"].clone())?;
    println!("released: scheme,particles,dt_ms,largest_tip_error_cm_to_0.1_s,to_0.25_s,to_0.5_s");
    for (scheme, n, dt) in [
        (Scheme::BackwardEuler, 10, 1e-4),
        (Scheme::BackwardEuler, 20, 1e-4),
        (Scheme::BackwardEuler, 40, 1e-4),
        (Scheme::BackwardEuler, 40, 5e-5),
        (Scheme::BackwardEuler, 20, 5e-4),
        (Scheme::BackwardEuler, 20, 1e-3),
        (Scheme::Trapezoidal, 20, 1e-4),
    ] {
        let ours = rods::released(length, n, dt, scheme, 0.005, reference.len())?;
        let to = |end: usize| {
            (0..=end).map(|k| (ours[k][0] - reference[k][0]).hypot(ours[k][1] - reference[k][1])).fold(0.0, f64::max)
        };
        println!("{scheme:?},{n},{},{:.4},{:.4},{:.4}", 1e3 * dt, to(20), to(50), to(100));
    }
    Ok(())
}

fn twist() -> Result<(), Box<dyn std::error::Error>> {
    println!("twist: particles,sense,critical_angle,error,bow_at_0.8_of_it_cm");
    for n in [42, 82] {
        for sense in [1.0, -1.0] {
            let [found, aside] = rods::critical_twist(10.0, n, sense)?;
            println!("{n},{sense},{found:.4},{:.3e},{aside:.3}", found / rods::greenhill() - 1.0);
        }
    }
    Ok(())
}

fn coil() -> Result<(), Box<dyn std::error::Error>> {
    println!("coil: gravity,per_turn,perturbed,springs,sag_error_cm,extension_error_at_0.02,at_0.05,at_0.1");
    let data = fixture("helix.json")?;
    for (index, gravity) in [(2, 0.0), (1, GRAVITY)] {
        let case = &data["cases"][index];
        let loads: Vec<f64> = serde_json::from_value(case["loads"].clone())?;
        let z: Vec<f64> = serde_json::from_value(case["kirchhoff_z"].clone())?;
        for per_turn in [8, 10, 11, 15, 20, 30] {
            let coil = Coil::new(per_turn)?;
            for springs in [CoilSprings::AsStraight, CoilSprings::AsCurl, CoilSprings::Naive] {
                if springs == CoilSprings::AsCurl && coil.is_perturbed {
                    continue;
                }
                let Some(material) = coil.material(springs) else {
                    println!("{gravity},{per_turn},{},{springs:?},no positive constants,,,", coil.is_perturbed);
                    continue;
                };
                let ours = coil.heights(&material, gravity, &loads)?;
                let error = |k: usize| (ours[k] - ours[0]) / (z[k] - z[0]) - 1.0;
                println!(
                    "{gravity},{per_turn},{},{springs:?},{:.4},{:.4},{:.4},{:.4}",
                    coil.is_perturbed,
                    ours[0] - z[0],
                    error(1),
                    error(2),
                    error(3)
                );
            }
        }
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global()?;
    let only = std::env::args().nth(1).unwrap_or_default();
    println!("EI {EI} GJ {GJ} dyn cm2, {DENSITY} g/cm");
    for (name, table) in [
        ("cantilever", cantilever as fn() -> Result<(), Box<dyn std::error::Error>>),
        ("swing", swing),
        ("twist", twist),
        ("coil", coil),
    ] {
        if name.contains(&only) {
            table()?;
        }
    }
    Ok(())
}
