// The ground: lines as thin as they are far, and a shadow that is soft where what throws it is high, with a balloon's color.
(() => {
  "use strict";
  const WIDTH = "0.014";  // of a line, over the cell
  const LINE = "0.42";  // how much of a line is seen
  const LAMP = "0.17";  // half the lamp's size over its distance: so fast does a shadow soften with height
  const FAR = "39.9";  // depth of the light's view, in halves of its width (look.js, aim)
  const tint = {value: null};

  const FUNCTIONS = `
    uniform vec3 tint;

    // The share of a pixel that lines cover, exactly: nothing shimmers. After Inigo Quilez, "filterable procedurals".
    float getGrid(float size, float thickness) {
      vec2 at = localPosition.xz / size + 0.5 * ${WIDTH};
      vec2 wide = max(fwidth(at), 1e-5), high = at + 0.5 * wide, low = at - 0.5 * wide;
      vec2 covered = floor(high) * ${WIDTH} + min(fract(high), ${WIDTH}) - floor(low) * ${WIDTH} - min(fract(low), ${WIDTH});
      vec2 line = clamp(covered / wide, 0.0, 1.0);
      return ${LINE} * (line.x + line.y - line.x * line.y);
    }

    #if defined( USE_SHADOWMAP ) && defined( SHADOWMAP_TYPE_PCF ) && NUM_DIR_LIGHT_SHADOWS > 0
    // Whether something is between the lamp and a place, farther above it than a height, in halves of the light's view.
    float blocked(vec3 place, float height) {
      #ifdef USE_REVERSED_DEPTH_BUFFER
        place.z += height / ${FAR};
      #else
        place.z -= height / ${FAR};
      #endif
      return 1.0 - texture(directionalShadowMap[0], place);
    }

    // A shadow as wide at its edge as what throws it is high above: how high is asked at steps of height.
    float softShadow() {
      vec3 place = vDirectionalShadowCoord[0].xyz / vDirectionalShadowCoord[0].w;
      if (any(lessThan(place, vec3(0.0))) || any(greaterThan(place, vec3(1.0)))) return 0.0;
      float turn = interleavedGradientNoise(gl_FragCoord.xy) * PI2, any_ = 0.0, height = 0.0;
      for (int n = 0; n < 12; n++) {
        vec3 near = place + vec3(vogelDiskSample(n, 12, turn) * 0.11, 0.0);
        float first = blocked(near, 0.01);
        any_ += first;
        if (first > 0.0) height += 0.12 * first + 0.28 * blocked(near, 0.12) + 0.5 * blocked(near, 0.4)
          + 0.9 * blocked(near, 0.9);
      }
      if (any_ == 0.0) return 0.0;
      float radius = clamp(0.5 * ${LAMP} * height / any_, 0.004, 0.11), dark = 0.0;
      for (int n = 0; n < 24; n++) dark += blocked(place + vec3(vogelDiskSample(n, 24, turn) * radius, 0.0), 0.01);
      return dark / 24.0;
    }
    #else
    float softShadow() { return 0.0; }
    #endif
  `;
  const REPLACED = [
    [/float getGrid[\s\S]*?\n\s*}\n/, FUNCTIONS],
    // What is below the ground is not seen through it, but far away, where it ends.
    ["float fade = pow(d, fadeStrength);", "float fade = smoothstep(0.0, 0.22, d);"],
    ["float shadowMask = getShadowMask();", "float shadowMask = 1.0 - softShadow();"],
    // Of what falls through rubber some is left, in its color, and lines are in the shadow, too; viser's is black, below.
    ["premulRgb *= (1.0 - shadowAlpha);", ""],
    ["alpha = gridAlpha + alpha * (1.0 - gridAlpha);", `alpha = gridAlpha + alpha * (1.0 - gridAlpha);
      premulRgb *= mix(vec3(1.0), tint, shadowAlpha);`],
    // Eight bits of a faint gradient would be seen as steps.
    ["#include <fog_fragment>", `#include <fog_fragment>
      gl_FragColor += (fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715)))) - 0.5) / 200.0;`],
  ];

  // Dresses viser's grid (Grid.tsx), once; its shadow has the mean color of what throws one.
  window.balloonWarpGround = (material, things) => {
    const {uniforms} = material;
    if (!uniforms.planeColor || !uniforms.shadowOpacity) return;
    const colors = things.map((mesh) => mesh.material.color);
    if (colors.length) {
      tint.value = tint.value || uniforms.planeColor.value.clone();
      tint.value.setRGB(0, 0, 0);
      for (const color of colors) tint.value.add(color);
      tint.value.multiplyScalar(0.35 / colors.length);
    }
    if (uniforms.tint || !tint.value) return;
    uniforms.tint = tint;
    for (const [was, is] of REPLACED) material.fragmentShader = material.fragmentShader.replace(was, is);
    material.needsUpdate = true;
  };
})();
