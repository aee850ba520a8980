#[test]
fn dbg() {
    use crate::sdf::mesh::ClosedMesh;
    use nalgebra::Vector3;
    let text = std::fs::read_to_string("/work/shared/data/solids/comb.stl").unwrap();
    let mut pts = vec![]; let mut tris = vec![];
    for l in text.lines() { let w: Vec<&str> = l.split_whitespace().collect(); if w.first() == Some(&"vertex") { let p = [0,1,2].map(|k: usize| w[1+k].parse::<f32>().unwrap()*0.1); pts.push(p); } }
    for t in 0..pts.len()/3 { tris.push([3*t as u32, 3*t as u32+1, 3*t as u32+2]); }
    let c = ClosedMesh::new(&pts, &tris).unwrap();
    println!("{} tris, {} after, bounds {:?}", tris.len(), c.triangles.len(), c.bounds);
    let mut seed = 1u64;
    let mut unit = || { seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407); (seed >> 40) as f32 / (1u64<<24) as f32 };
    let (mut bad_w, mut bad_all, mut bad_d) = (0,0,0);
    let mut hint = 0;
    for _ in 0..2000 {
        let p = c.bounds.min + c.bounds.size().map(|s| s*unit());
        let (w, all) = (c.tree.winding(p), c.tree.winding_of_all(p));
        let mut d = [0.0]; c.tree.distances(&[p], &mut hint, &mut d);
        let da = c.tree.nearest_of_all(p);
        if (w-all).abs() > 0.2 { bad_w += 1; if bad_w < 5 { println!("{w} {all} {p:?} {da}"); } }
        if (all-all.round()).abs() > 0.05 { bad_all += 1; if bad_all < 5 { println!("all {all} {p:?} {da}"); } }
        if (d[0]-da).abs() > 1e-5 { bad_d += 1; if bad_d < 5 { println!("d {d:?} {da} {p:?}"); } }
    }
    println!("{bad_w} {bad_all} {bad_d}");
    let f = crate::bake_from_mesh(&pts, &tris, crate::BakeParams::automatic()).unwrap();
    println!("cell {} nodes {:?} max_error {} far {}", f.cell(), f.nodes(), f.max_error(), f.far_error());
    let mut n = 0;
    for _ in 0..20000 {
        let p = c.bounds.min + c.bounds.size().map(|s| s*unit());
        let inside = c.is_inside(p); let mut d = [0.0]; c.tree.distances(&[p], &mut hint, &mut d);
        if d[0] > f.cell() && (f.distance(p) < 0.0) != inside { n += 1; if n < 8 { let g = (p - f.bounds().min) / f.cell(); println!("{p:?} g {g:?} d {d:?} sampled {} inside {inside}", f.distance(p)); } }
    }
    println!("{n} wrong");
    let _ = Vector3::<f32>::zeros();
}
