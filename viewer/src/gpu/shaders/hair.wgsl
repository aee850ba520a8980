// Hair: a smooth curve through the particles of each strand, coloured point by point, then drawn as ribbons that face the
// camera in their true width: one thinner than a pixel meets as many of its samples as it covers, in the mean.

const PI: f32 = 3.14159265;

struct Curve {
    weights: vec4<f32>,
    slopes: vec4<f32>,
}

fn curve_at(u: f32) -> Curve {
    let v = 1.0 - u;
    if hair.curve == 0u {
        return Curve(
            vec4<f32>(v * v * v, 3.0 * u * u * u - 6.0 * u * u + 4.0, 3.0 * v * v * v - 6.0 * v * v + 4.0, u * u * u) / 6.0,
            vec4<f32>(-v * v, 3.0 * u * u - 4.0 * u, 4.0 * v - 3.0 * v * v, u * u) / 2.0,
        );
    }
    return Curve(
        vec4<f32>(-u * v * v, 2.0 + u * u * (3.0 * u - 5.0), 2.0 + v * v * (3.0 * v - 5.0), -u * u * v) / 2.0,
        vec4<f32>(-v * (v - 2.0 * u), u * (9.0 * u - 10.0), -v * (9.0 * v - 10.0), u * (u - 2.0 * v)) / 2.0,
    );
}

fn bell(x: f32, width: f32) -> f32 {
    return exp(-0.5 * x * x / (width * width)) / (width * 2.5066283);
}

// Light scattered once by a fibre towards `v`, per light from `l`: mirror lobe (R), through the fibre (TT), and once
// around inside it (TRT), as in Marschner et al. 2003 with bells in place of their azimuthal sums.
fn fibre(t: vec3<f32>, l: vec3<f32>, v: vec3<f32>, base: vec3<f32>, tilt: f32) -> vec3<f32> {
    let sin_l = clamp(dot(t, l), -1.0, 1.0);
    let sin_v = clamp(dot(t, v), -1.0, 1.0);
    let cos_l = sqrt(1.0 - sin_l * sin_l);
    let cos_v = sqrt(1.0 - sin_v * sin_v);
    let half_sum = 0.5 * (asin(sin_l) + asin(sin_v));
    let cos_d = max(cos(0.5 * (asin(sin_v) - asin(sin_l))), 0.2);
    let cos_phi = clamp((dot(l, v) - sin_l * sin_v) / max(cos_l * cos_v, 1e-3), -1.0, 1.0);
    let phi = acos(cos_phi);
    // Reflectance of keratin, index 1.55.
    let facing = 1.0 - cos_d * sqrt(0.5 + 0.5 * cos_phi);
    let mirror = 0.0465 + 0.9535 * pow(facing, 5.0);
    // Scales of the cuticle tilt the lobes towards the root by -2, 1 and 3 halves of 3 degrees.
    let r = bell(half_sum + 2.0 * tilt, 0.11) * mirror * 0.14 * cos(0.5 * phi);
    let passed = (1.0 - mirror) * (1.0 - mirror);
    let tt = bell(half_sum - tilt, 0.08) * passed * bell(PI - phi, 0.45) * 0.5;
    let trt = bell(half_sum - 3.0 * tilt, 0.20) * passed * mirror * (0.35 + 1.6 * bell(phi, 0.55));
    let once = pow(base, vec3<f32>(0.55 / cos_d));
    let twice = pow(base, vec3<f32>(0.75 / cos_d));
    let scale = cos_l / (cos_d * cos_d);
    return scale * (vec3<f32>(r) + tt * once + trt * twice);
}

fn shaded(p: vec3<f32>, t: vec3<f32>, base_in: vec3<f32>, along: f32, strand: u32) -> vec3<f32> {
    let is_measure = (hair.flags & 2u) != 0u;
    let v = normalize(frame.eye.xyz - p);
    if is_measure {
        // Light only brings out the shape: hue stays, and the brightest is the colour itself.
        let lit = light_at(0u, p, 0.0, 0.3);
        let l = frame.lights[0].toward.xyz;
        let across = sqrt(max(1.0 - dot(t, l) * dot(t, l), 0.0));
        return base_in * (0.35 + 0.65 * across * pow(lit.x, 0.35) * (0.3 + 0.7 * lit.y));
    }
    // Strands differ a little, roots are darker and tips bleached.
    let tint = 0.65 + 0.7 * share_of(strand * 3u + 1u);
    let tilt = 0.052 + 0.03 * (share_of(strand * 3u + 2u) - 0.5);
    let base = clamp(base_in * tint * (0.8 + 0.45 * smoothstep(0.1, 1.0, along)), vec3<f32>(1e-3), vec3<f32>(0.95));
    var sum = vec3<f32>(0.0);
    var open = 0.0;
    for (var k = 0u; k < 3u; k++) {
        let l = frame.lights[k].toward.xyz;
        let lit = light_at(k, p, 0.0, 0.3);
        let light = frame.lights[k].colour.rgb * lit.y;
        sum += 2.2 * light * lit.x * fibre(t, l, v, base, tilt);
        // Light scattered by other fibres: reaches deeper, takes their colour, remembers no direction but the fibre's.
        let deep = pow(lit.x, 0.4);
        let across = sqrt(max(1.0 - dot(t, l) * dot(t, l), 0.0));
        let hue = pow(base / max(max(base.r, base.g), base.b), vec3<f32>(1.0 - deep));
        sum += light * deep * base * hue * (0.06 + 0.30 * across) * (0.65 + 0.35 * dot(l, v));
        open += pow(lit.x, 0.25) * (0.5 + 0.5 * lit.y) / 3.0;
    }
    return sum + base * (0.03 + 0.22 * open) * vec3<f32>(0.9, 0.95, 1.0);
}

// A colour up to 4 in three times ten bits, finest near black.
fn packed(colour: vec3<f32>) -> u32 {
    let q = vec3<u32>(sqrt(clamp(colour, vec3<f32>(0.0), vec3<f32>(4.0)) * 0.25) * 1023.0 + 0.5);
    return q.x | (q.y << 10u) | (q.z << 20u);
}

fn unpacked(word: u32) -> vec3<f32> {
    let q = vec3<f32>(vec3<u32>(word & 1023u, (word >> 10u) & 1023u, (word >> 20u) & 1023u)) / 1023.0;
    return 4.0 * q * q;
}

fn write_corner(n: u32, clip: vec4<f32>, colour: u32) {
    let word = bitcast<vec4<u32>>(clip);
    corners[5u * n] = word.x;
    corners[5u * n + 1u] = word.y;
    corners[5u * n + 2u] = word.z;
    corners[5u * n + 3u] = word.w;
    corners[5u * n + 4u] = colour;
}

// Both corners of a ribbon at point `k`. All strands are one strip: the first and last corner of each stand twice, which
// joins it to its neighbours by triangles without area.
fn write_ribbon(strand: u32, k: u32, p: vec3<f32>, t: vec3<f32>, colour: u32) {
    let last = hair.n_points - 1u;
    let side = cross(t, frame.eye.xyz - p);
    let outward = side / max(length(side), 1e-9);
    // The last third tapers to a third of the width.
    let width = hair.width * (1.0 - 0.67 * smoothstep(0.67, 1.0, f32(k) / f32(last)));
    let middle = frame.clip_from_world * vec4<f32>(p, 1.0);
    let half = frame.clip_from_world * vec4<f32>(0.5 * width * outward, 0.0);
    let at = strand * (2u * hair.n_points + 2u) + 1u + 2u * k;
    write_corner(at, middle - half, colour);
    write_corner(at + 1u, middle + half, colour);
    if k == 0u { write_corner(at - 1u, middle - half, colour); }
    if k == last { write_corner(at + 2u, middle + half, colour); }
}

@compute @workgroup_size(64)
fn curves(@builtin(global_invocation_id) id: vec3<u32>) {
    let n = id.x;
    if n >= hair.n_strands * hair.n_points { return; }
    let strand = order[hair.first_strand + n / hair.n_points];
    let k = n % hair.n_points;
    let last = hair.n_particles - 1u;
    let i = min(k / hair.pieces, last - 1u);
    let u = f32(k - i * hair.pieces) / f32(hair.pieces);
    let p1 = position(strand, i);
    let p2 = position(strand, i + 1u);
    // Beyond both ends strands go on straight, so that the curve begins at the root and ends at the tip.
    var p0 = 2.0 * p1 - p2;
    var p3 = 2.0 * p2 - p1;
    if i > 0u { p0 = position(strand, i - 1u); }
    if i + 2u <= last { p3 = position(strand, i + 2u); }
    let c = curve_at(u);
    let p = c.weights.x * p0 + c.weights.y * p1 + c.weights.z * p2 + c.weights.w * p3;
    let slope = c.slopes.x * p0 + c.slopes.y * p1 + c.slopes.z * p2 + c.slopes.w * p3;
    let t = slope / max(length(slope), 1e-9);
    var base = hair.base.rgb;
    if (hair.flags & 1u) != 0u {
        let at = strand * hair.n_particles + i;
        base = mix(unpacked(colours[at]), unpacked(colours[at + 1u]), u);
    }
    var colour = base;
    if frame.info.x == 0.0 { colour = shaded(p, t, base, (f32(i) + u) / f32(last), strand); }
    write_ribbon(n / hair.n_points, k, p, t, packed(colour));
}

struct Ribbon {
    @builtin(position) clip: vec4<f32>,
    @location(0) colour: vec3<f32>,
}

@vertex
fn ribbon(@location(0) clip: vec4<f32>, @location(1) colour: vec4<f32>) -> Ribbon {
    return Ribbon(clip, 4.0 * colour.rgb * colour.rgb);
}

@fragment
fn ribbon_colour(in: Ribbon) -> @location(0) vec4<f32> {
    return vec4<f32>(in.colour, 1.0);
}
