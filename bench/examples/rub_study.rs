#![allow(missing_docs, clippy::all, clippy::print_stdout)]
use collision::{MovingSolid, SolidPose};
use cpu_time::ProcessTime;
use hair_bench::full_space::FullSpace;
use hair_bench::full_space::{settle, thickness_cm};
use hair_bench::head_motion::*;
use hair_bench::world::World;
use io_formats::frames::{FrameInfo, FrameSource, FrameStore, FrameStoreWriter};
use io_formats::groom::UniformGroom;
use io_formats::scene::Scene;
use nalgebra::{Isometry3, Vector3};
use std::collections::HashMap;
use std::path::Path;
use strand_sim::InteractionParams;
use strand_sim::StepParams;
use strand_sim::interaction::*;

fn world(n: usize) -> World {
    let text =
        std::fs::read_to_string("/tmp/h/full.toml").unwrap().replace("strands = 150000", &format!("strands = {n}"));
    World::build(Scene::from_toml(&text, Path::new(".")).unwrap(), |_| ()).unwrap()
}
fn rest(world: &World, n: usize) -> UniformGroom {
    let path = if n == 150000 {
        std::fs::read_dir("/tmp/h/full_out/cache")
            .unwrap()
            .map(|f| f.unwrap().path())
            .find(|p| p.to_str().unwrap().contains("rest-"))
            .unwrap()
    } else {
        format!("/tmp/h/rub/rest-{n}.frames").into()
    };
    let mut rest =
        UniformGroom { n_strands: n, n_particles: world.groom.n_particles, points: world.groom.points.clone() };
    if path.exists() {
        FrameStore::open(&path).unwrap().read(0, &mut rest.points).unwrap();
        return rest;
    }
    rest = settle(&world.groom, &world.head, world.material, &StepParams::standard(), |_| ()).unwrap();
    let mut w = FrameStoreWriter::create(&path, n, rest.n_particles, 0).unwrap();
    w.append(FrameInfo { sequence: 0, time_s: 0.0 }, &rest.points).unwrap();
    w.finish().unwrap();
    rest
}
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let n: usize = args[2].parse().unwrap();
    let world = world(n);
    let rest = rest(&world, n);
    match args[1].as_str() {
        "count" => count(&rest, n),
        "slice" => slice(&rest, n),
        "run" => run(&world, &rest, n, &args[3..]),
        _ => {}
    }
}
fn count(rest: &UniformGroom, n: usize) {
    let pos: Vec<Vector3<f64>> = rest.points.iter().map(|&p| Vector3::from(p).cast()).collect();
    let np = rest.n_particles;
    let inv: Vec<f64> = (0..pos.len()).map(|i| if i % np < 2 { 0.0 } else { 1.0 / 2e-5 }).collect();
    let strands = Strands::new(np, &pos, &inv);
    let th = thickness_cm(n);
    for reach in [th, 1.5 * th] {
        let mut near = NearPairs::default();
        let t = ProcessTime::now();
        near.find(&strands, reach);
        let cpu = t.elapsed().as_secs_f64();
        let mut deg = vec![0u32; strands.n_segments()];
        let mut angle = [0usize; 10];
        for p in near.pairs() {
            deg[p.i as usize] += 1;
            deg[p.j as usize] += 1;
            let (a, b) = (strands.segment(p.i as usize), strands.segment(p.j as usize));
            let c = (a[1] - a[0]).normalize().cross(&(b[1] - b[0]).normalize()).norm();
            angle[((c * 10.0) as usize).min(9)] += 1;
        }
        deg.sort();
        println!(
            "n {n} reach {reach:.4}: {} pairs, {:.2} per segment, cpu {cpu:.2} = {:.2} us/seg; degree pct 10 {} 50 {} 90 {} 99 {} max {}; sin angle {:?}",
            near.pairs().len(),
            near.pairs().len() as f64 / deg.len() as f64,
            cpu * 1e6 / deg.len() as f64,
            deg[deg.len() / 10],
            deg[deg.len() / 2],
            deg[deg.len() * 9 / 10],
            deg[deg.len() * 99 / 100],
            deg[deg.len() - 1],
            angle.map(|a| (100 * a) / near.pairs().len().max(1))
        );
    }
}

fn slice(rest: &UniformGroom, n: usize) {
    let pos: Vec<Vector3<f64>> = rest.points.iter().map(|&p| Vector3::from(p).cast()).collect();
    slices_of(&pos, rest.n_particles, n, n <= 20000);
}
fn slices_of(pos: &[Vector3<f64>], np: usize, n: usize, exact: bool) {
    let inv: Vec<f64> = (0..pos.len()).map(|i| if i % np < 2 { 0.0 } else { 1.0 / 2e-5 }).collect();
    let strands = Strands::new(np, pos, &inv);
    let th = thickness_cm(n);
    let mut near = NearPairs::default();
    if exact {
        near.find(&strands, th);
    }
    let mut s = SliceSearch::default();
    let mut b = Blocks::default();
    for (h, w, m) in [(0.5, 3.0, 4), (0.5, 3.0, 16), (1.0, 3.0, 16), (0.5, 6.0, 16), (0.25, 3.0, 16), (0.5, 2.0, 16)] {
        let p = ContactSampling { spacing_cm: h, window: w, max_contacts: m };
        s.find(&strands, th, &p, &mut b);
        let t = ProcessTime::now();
        s.find(&strands, th, &p, &mut b);
        let cpu = t.elapsed().as_secs_f64();
        let mut v = vec![Vector3::zeros(); pos.len()];
        let t = ProcessTime::now();
        let r = b.repel(&strands, &RepulsionParams { thickness_cm: th, ..RepulsionParams::standard() }, 0.005, &mut v);
        let cpu_r = t.elapsed().as_secs_f64();
        let pairs: Vec<[u32; 2]> = b.pairs().collect();
        let mut set: Vec<[u32; 2]> = pairs.clone();
        set.sort();
        set.dedup();
        let mut recall = [[0usize; 10]; 2];
        for p in near.pairs() {
            let (a, b) = (strands.segment(p.i as usize), strands.segment(p.j as usize));
            let c = (a[1] - a[0]).normalize().cross(&(b[1] - b[0]).normalize()).norm();
            let k = ((c * 10.0) as usize).min(9);
            recall[0][k] += 1;
            recall[1][k] += usize::from(set.binary_search(&[p.i, p.j]).is_ok());
        }
        let tot: usize = recall[1].iter().sum();
        println!(
            "n {n} h {h} w {w} m {m}: {} named ({} distinct), {} touching, exact {}; recall {:.3} by sin {:?}; search cpu {cpu:.3} repel cpu {cpu_r:.3}",
            pairs.len(),
            set.len(),
            r.touching,
            near.pairs().len(),
            tot as f64 / near.pairs().len().max(1) as f64,
            (0..10).map(|k| 100 * recall[1][k] / recall[0][k].max(1)).collect::<Vec<_>>()
        );
    }
}
/// run N steps still modes...: each simulated in step with the others.
fn run(world: &World, rest: &UniformGroom, n: usize, args: &[String]) {
    let steps: usize = args[0].parse().unwrap();
    let moving: usize = args[1].parse().unwrap();
    let th = thickness_cm(n);
    let modes: Vec<&String> = args[2..].iter().collect();
    let mut fulls: Vec<FullSpace> = modes
        .iter()
        .map(|m| {
            let full = world.full_space(rest, &StepParams::standard()).unwrap();
            let parts: Vec<&str> = m.split(',').collect();
            match parts[0] {
                "none" => full,
                "exact" => full.meeting(InteractionParams::rubbing(th)),
                "sampled" => {
                    let mut p = InteractionParams::rubbing_sampled(th);
                    if parts.len() > 1 {
                        p.sampling = Some(ContactSampling {
                            spacing_cm: parts[1].parse().unwrap(),
                            window: parts[2].parse().unwrap(),
                            max_contacts: parts[3].parse().unwrap(),
                        });
                    }
                    full.meeting(p)
                }
                _ => panic!(),
            }
        })
        .collect();
    let motion = random_head_motion(7, 0, 0.01 * moving as f64, &HeadMotionParams::lively());
    let np = rest.n_particles;
    let mut now: Vec<Vec<[f32; 3]>> = vec![Vec::new(); modes.len()];
    let mut before = now.clone();
    let mut cpu = vec![0.0; modes.len()];
    let mut sums: HashMap<usize, f64> = HashMap::new();
    let mut exact_pairs: Vec<(u32, u32)> = Vec::new();
    let base = modes.iter().position(|m| *m == "exact").unwrap_or(0);
    for step in 1..=steps {
        let at = |k: usize| motion.pose_at(0.01 * k.min(moving) as f64);
        let (from, to): (Isometry3<f64>, _) = (at(step - 1), at(step));
        let head = MovingSolid { solid: &world.head, pose: SolidPose { from, to } };
        let mut line = format!("{step:3}");
        for (k, full) in fulls.iter_mut().enumerate() {
            let t = ProcessTime::now();
            full.step(0.01, &to, &[head]);
            cpu[k] += t.elapsed().as_secs_f64();
            std::mem::swap(&mut before[k], &mut now[k]);
            full.positions_in_head(&mut now[k]);
        }
        // pairs near each other in the exact run
        let every = 10;
        if step % every == 0 {
            let v3 = |p: [f32; 3]| Vector3::from(p).cast::<f64>();
            let pos: Vec<Vector3<f64>> = now[base].iter().map(|&p| v3(p)).collect();
            if n <= 20000 {
                let inv = vec![1.0; pos.len()];
                let strands = Strands::new(np, &pos, &inv);
                let mut near = NearPairs::default();
                near.find(&strands, th);
                exact_pairs = near
                    .pairs()
                    .iter()
                    .filter(|p| p.i as usize / (np - 1) != p.j as usize / (np - 1))
                    .map(|p| (p.i, p.j))
                    .collect();
            }
            for k in 0..modes.len() {
                let (mut d2, mut c) = (0.0, 0.0);
                let mut ke = 0.0;
                for (p, (x, y)) in now[k].iter().zip(&now[base]).enumerate() {
                    if p % np >= np / 2 {
                        d2 += (v3(*x) - v3(*y)).norm_squared();
                        c += 1.0;
                    }
                    if before[k].len() == now[k].len() {
                        ke += (v3(now[k][p]) - v3(before[k][p])).norm_squared() / 1e-4;
                    }
                }
                ke /= now[k].len() as f64;
                let vel = |p: usize| (v3(now[k][p]) - v3(before[k][p])) / 0.01;
                let mut slide = 0.0;
                for &(i, j) in &exact_pairs {
                    let f = |s: u32| {
                        let s = s as usize;
                        let p = s + s / (np - 1);
                        (vel(p) + vel(p + 1)) * 0.5
                    };
                    slide += (f(i) - f(j)).norm();
                }
                line += &format!(
                    " | {} rms {:.3} v_rms {:.2} slide {:.2} touching {}",
                    modes[k],
                    (d2 / c as f64).sqrt(),
                    ke.sqrt(),
                    slide / exact_pairs.len().max(1) as f64,
                    fulls[k].met().map_or(0, |r| r.repulsion.touching)
                );
            }
            println!("{line}");
            if step == 30 && n <= 20000 {
                slices_of(&pos, np, n, true);
            }
        }
        let _ = &mut sums;
    }
    for k in 0..modes.len() {
        let r = fulls[k].met().copied();
        println!(
            "{}: {:.3} cpu-s a step; last: {:?}",
            modes[k],
            cpu[k] / steps as f64,
            r.map(|r| (r.integrate, r.collide, r.stick))
        );
    }
    println!(
        "{}",
        std::fs::read_to_string("/proc/self/status")
            .unwrap()
            .lines()
            .filter(|l| l.starts_with("VmHWM"))
            .collect::<String>()
    );
}
