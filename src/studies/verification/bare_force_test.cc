#include "verification/bare_force.h"

#include <gtest/gtest.h>

#include <random>

#include "contact/test_model.h"
#include "palpate/direct/direct_methods.h"

namespace palpate {
namespace {

// independent implementations with only the field in common
TEST(BareForce, EqualsTheTrilinearMethod) {
  constexpr unsigned kSeed = 11;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> coordinate(-34, 34);
  const Model model = testing::ball_model();
  const Field in_eight_bits = [&] {
    Volume<std::uint8_t> volume(model.field->geometry());
    const Volume<float> values = model.field->values();
    for (std::size_t n = 0; n < volume.voxels().size(); ++n)
      volume.voxels()[n] = static_cast<std::uint8_t>(255 * values.voxels()[n]);
    return Field(volume);
  }();
  int pushed = 0;
  for (const Field* field : {&*model.field, &in_eight_bits}) {
    for (int n = 0; n < 3000; ++n) {
      // some points are outside the volume, which ends at 30 mm
      const Point<Patient> tip(coordinate(random), coordinate(random), coordinate(random));
      FieldSample sample = sample_central_differences(*field, tip);
      // a gradient that is only rounding error has an arbitrary direction
      if (sample.gradient.norm() < 1e-6) sample.gradient = {};
      const Vector<Patient> expected = normal_force(sample, 3);
      EXPECT_LT((bare_force_N(*field, 3, tip) - expected).norm(), 1e-9) << tip.eigen().transpose();
      pushed += expected != Vector<Patient>();
    }
  }
  EXPECT_GT(pushed, 500);
}

}  // namespace
}  // namespace palpate
