// The picture: the mean of all samples of a pixel, each brought into 0..1 first, over the backdrop, as sRGB.

@vertex
fn whole(@builtin(vertex_index) n: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(f32(n & 1u) * 4.0 - 1.0, f32(n >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

// The identity up to 0.7, then ever slower up to 1.
fn tone(x: vec3<f32>) -> vec3<f32> {
    return select(1.0 - 0.3 * exp((0.7 - x) / 0.3), x, x < vec3<f32>(0.7));
}

@fragment
fn finish(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let scale = i32(frame.info.y);
    let first = vec2<i32>(at.xy) * scale;
    let backdrop = mix(frame.backdrop_top.rgb, frame.backdrop_bottom.rgb, at.y / frame.info.w);
    var sum = vec3<f32>(0.0);
    for (var y = 0; y < scale; y++) {
        for (var x = 0; x < scale; x++) {
            for (var s = 0; s < 4; s++) {
                let drawn = textureLoad(samples, first + vec2<i32>(x, y), s);
                var colour = backdrop;
                if drawn.a > 0.5 { colour = select(drawn.rgb, tone(drawn.rgb), frame.info.x == 0.0); }
                sum += colour;
            }
        }
    }
    let c = clamp(sum / f32(4 * scale * scale), vec3<f32>(0.0), vec3<f32>(1.0));
    let bright = 1.055 * pow(max(c, vec3<f32>(1e-6)), vec3<f32>(1.0 / 2.4)) - 0.055;
    return vec4<f32>(select(bright, 12.92 * c, c <= vec3<f32>(0.0031308)), 1.0);
}
