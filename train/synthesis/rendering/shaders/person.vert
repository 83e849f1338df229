uniform mat4 clip_from_world, light_clip_from_world, sky_clip_from_world;
uniform float puff_shirt, puff_trousers, loose_shirt, loose_trousers, flare_hem, flare_sleeve, flare_leg, flare_skirt;
uniform float pleats, bulge, drape_shirt, drape_trousers, shoe_bulk, sole, toe, hair_volume, hair_top, hair_lumps, hat_volume, seed;
uniform int covered;
uniform sampler2DArray folds;
in vec3 position, normal, slack, rest;
in vec4 traits; // head, eye, arm, hanging off
out float arm, eye, head;
out vec3 N, P, Q;
out vec4 light_position;
out vec3 sky_position;

float lump(vec2 at, float layer) { return textureLod(folds, vec3(at, layer), 2.5).b - .5; }

void main() {
  arm = traits.z; eye = traits.y; head = traits.x;
  vec3 q = rest, w = position;
  float offset = 0., height = max(-q.z, 0.);
  if (part == TROUSERS || part == SHIRT) {
    float along = arm > .5 ? arm_along(q) : q.z, side = q.x > 0. ? .37 : 0.;
    float wave = lump(vec2(q.y * 2.5 + side, along * 2.2) + seed, 0.) * bulge;
    if (part == SHIRT) {
      w = mix(position, slack, loose_shirt);
      offset = puff_shirt + drape_shirt * traits.w;
      if (arm > .5) offset += flare_sleeve * smoothstep(.13, 0., sleeve - along) + wave * smoothstep(-.05, .08, along);
      else offset += flare_hem * smoothstep(.30, 0., q.z - hem) + wave * smoothstep(.06, -.05, q.z - .45);
      offset = max(offset, .003);
      if (has_trousers == 1 && arm < .5) { // over the trousers, or in them
        float waistband = waist - q.z;
        offset = hem < waist - .06 ? max(offset, puff_trousers + .006 * smoothstep(-.02, .03, waistband))
                                   : mix(offset, puff_trousers * .4, smoothstep(-.08, .0, waistband));
      }
    } else {
      w = mix(position, slack, loose_trousers);
      offset = puff_trousers + drape_trousers * traits.w + flare_leg * smoothstep(.0, -.5, q.z) + wave * smoothstep(.05, -.1, q.z);
      if (has_shirt == 1 && hem < waist - .06) { // tucked in under the shirt that hangs over them
        float under = .7 * (puff_shirt + drape_shirt * traits.w);
        offset = mix(offset, min(offset, under), smoothstep(-.07, .0, q.z - hem));
      }
      offset = max(offset, .002) * (cuff > -.66 ? 1. : 1. - .3 * smoothstep(.1, 0., q.z - cuff));
    }
  }
  if (part == SHOES) {
    w = mix(position, slack, .35);
    offset = shoe_bulk + (q.z < -.795 ? sole : 0.) + toe * smoothstep(-.14, -.19, q.y);
    offset *= smoothstep(-.01, .03, in_shoe(q)) * .6 + .4;
  }
  if (part == SKIRT) {
    float drop = skirt_top - q.z, turn = atan(q.y, q.x);
    offset = puff_trousers + .004 + flare_skirt * drop;
    offset += pleats * drop * sin(turn * 11. + seed) + bulge * 1.5 * drop * lump(vec2(turn * .3, q.z) + seed, 3.);
  }
  if (part == BODY) {
    if (in_shoe(q) < 0. && q.z < sock_top && abs(q.x) < .34) offset = .002;
    if (covered == 1 && head > .5 && eye < .5 && q.z < .70 && q.z > .612 && q.y < -.085) offset = .006;
    if (in_shirt(q, arm) > 0. || in_trousers(q, arm) > 0.) offset = -.003;
  }
  if (part == HAIR) {
    float inside = in_hair(q), grain = lump(vec2(q.x * 6., q.z * 4. + q.y * 5.) + seed, 0.);
    float volume = hair_volume * mix(1., hair_top, smoothstep(.77, .85, q.z));
    offset = .0015 + volume * smoothstep(-.004, .04, inside) * (1. + hair_lumps * grain);
    if (has_hat == 1) offset = min(offset, .4 * hat_volume + .003);
  }
  if (part == LONG_HAIR) offset = hair_volume * .35 - .004;
  if (part == HAT) offset = hat_volume * (hooded == 1 ? 1. + .35 * smoothstep(.75, .6, q.z) : 1.);
  w += normal * offset;
  gl_Position = PROJECTION * vec4(w, 1);
  light_position = light_clip_from_world * vec4(w, 1);
  sky_position = (sky_clip_from_world * vec4(w, 1)).xyz * .5 + .5;
  N = normal; P = w; Q = q;
}
