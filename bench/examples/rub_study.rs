#![allow(missing_docs, clippy::all, clippy::print_stdout)]
use cpu_time::ProcessTime;
use hair_bench::full_space::{settle, thickness_cm};
use hair_bench::world::World;
use io_formats::frames::{FrameInfo, FrameSource, FrameStore, FrameStoreWriter};
use io_formats::groom::UniformGroom;
use io_formats::scene::Scene;
use std::path::Path;
use strand_sim::StepParams;
use strand_sim::interaction::*;
use nalgebra::Vector3;

fn world(n: usize) -> World {
    let text = std::fs::read_to_string("/tmp/h/full.toml").unwrap().replace("strands = 150000", &format!("strands = {n}"));
    World::build(Scene::from_toml(&text, Path::new(".")).unwrap(), |_| ()).unwrap()
}
fn rest(world: &World, n: usize) -> UniformGroom {
    let path = if n == 150000 {
        std::fs::read_dir("/tmp/h/full_out/cache").unwrap().map(|f| f.unwrap().path()).find(|p| p.to_str().unwrap().contains("rest-")).unwrap()
    } else { format!("/tmp/h/rub/rest-{n}.frames").into() };
    let mut rest = UniformGroom { n_strands: n, n_particles: world.groom.n_particles, points: world.groom.points.clone() };
    if path.exists() { FrameStore::open(&path).unwrap().read(0, &mut rest.points).unwrap(); return rest; }
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
            deg[p.i as usize] += 1; deg[p.j as usize] += 1;
            let (a, b) = (strands.segment(p.i as usize), strands.segment(p.j as usize));
            let c = (a[1]-a[0]).normalize().cross(&(b[1]-b[0]).normalize()).norm();
            angle[((c * 10.0) as usize).min(9)] += 1;
        }
        deg.sort();
        println!("n {n} reach {reach:.4}: {} pairs, {:.2} per segment, cpu {cpu:.2} = {:.2} us/seg; degree pct 10 {} 50 {} 90 {} 99 {} max {}; sin angle {:?}",
            near.pairs().len(), near.pairs().len() as f64 / deg.len() as f64, cpu * 1e6 / deg.len() as f64,
            deg[deg.len()/10], deg[deg.len()/2], deg[deg.len()*9/10], deg[deg.len()*99/100], deg[deg.len()-1], angle.map(|a| (100*a) / near.pairs().len().max(1)));
    }
}
