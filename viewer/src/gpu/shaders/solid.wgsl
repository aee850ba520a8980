// Solids: lit by the same lights, in the shadow of hair and of each other.

struct Surface {
    @builtin(position) clip: vec4<f32>,
    @location(0) point: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) colour: vec3<f32>,
}

@vertex
fn solid(@location(0) point: vec3<f32>, @location(1) normal: vec3<f32>, @location(2) colour: vec3<f32>) -> Surface {
    return Surface(frame.clip_from_world * vec4<f32>(point, 1.0), point, normal, colour);
}

@fragment
fn solid_colour(in: Surface) -> @location(0) vec4<f32> {
    if frame.info.x != 0.0 { return vec4<f32>(in.colour, 1.0); }
    let n = in.normal / max(length(in.normal), 1e-9);
    let v = normalize(frame.eye.xyz - in.point);
    var sum = in.colour * (0.16 + 0.12 * (0.5 + 0.5 * n.y));
    for (var k = 0u; k < 3u; k++) {
        let l = frame.lights[k].toward.xyz;
        // Off the surface, so that it does not shadow itself.
        let lit = light_at(k, in.point + 0.15 * n, 0.0, 0.25);
        let light = frame.lights[k].colour.rgb * (0.08 + 0.92 * pow(lit.x, 0.6)) * lit.y;
        let facing = clamp((dot(n, l) + 0.15) / 1.15, 0.0, 1.0);
        let gloss = pow(max(dot(n, normalize(l + v)), 0.0), 24.0) * f32(dot(n, l) > 0.0);
        sum += light * (0.30 * in.colour * facing + 0.03 * gloss);
    }
    return vec4<f32>(sum, 1.0);
}
