//! Draws scenes that come over its standard input; started by programs that want pictures (`hair_viewer::RenderProcess`).

use hair_viewer::{Renderer, Scene, serve};
use std::io::{BufReader, BufWriter};

fn main() -> std::io::Result<()> {
    let mut scenes = BufReader::with_capacity(1 << 20, std::io::stdin().lock());
    let mut answers = BufWriter::new(std::io::stdout().lock());
    let ready = Renderer::new().map(|r| (r.adapter().to_owned(), move |scene: &Scene| r.picture(scene)));
    serve(ready, &mut scenes, &mut answers)
}
