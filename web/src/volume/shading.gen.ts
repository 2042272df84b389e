// Coefficients of the shading of surfaces, as in palpate's own pictures (VolumeLight).
// Written by PALPATE_UPDATE_DOCS=1 rendering_test --gtest_filter='Shading.*', not by hand.

export const SHADING = {
  ambient: 0.22,
  diffuse: 0.46,
  key: 0.34,
  keyDirection: [-0.45, 0.6, 0.66],
  specular: 0.05,
  shininess: 20,
} as const;
