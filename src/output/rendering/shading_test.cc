#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <string>

#include "palpate/base/file.h"
#include "palpate/rendering/volume_renderer.h"
#include "rendering/volume_terms.h"

namespace palpate {
namespace {

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

// The page's shader takes its coefficients from this file.
TEST(Shading, ThePageHasTheSameCoefficients) {
  const VolumeLight light;
  const auto& [right, up, towards] = light.key_direction;
  const std::string text =
      "// Coefficients of the shading of surfaces, as in palpate's own pictures (VolumeLight).\n"
      "// Written by PALPATE_UPDATE_DOCS=1 rendering_test --gtest_filter='Shading.*', not by hand.\n\n"
      "export const SHADING = {\n"
      "  ambient: " +
      number(light.ambient) + ",\n  diffuse: " + number(light.diffuse) + ",\n  key: " + number(light.key) +
      ",\n  keyDirection: [" + number(right) + ", " + number(up) + ", " + number(towards) +
      "],\n  specular: " + number(light.specular) +
      ",\n  shininess: " + std::to_string(internal::volume_picture::kShininess) + ",\n} as const;\n";
  const std::string path = PALPATE_SOURCE_DIR "/web/src/volume/shading.gen.ts";
  if (std::getenv("PALPATE_UPDATE_DOCS") != nullptr) {
    ASSERT_TRUE(write_file(path, text).ok());
    return;
  }
  const auto written = read_file(path);
  ASSERT_TRUE(written.ok()) << written.error().message();
  EXPECT_EQ(*written, text) << "PALPATE_UPDATE_DOCS=1 rendering_test --gtest_filter='Shading.*'";
}

}  // namespace
}  // namespace palpate
