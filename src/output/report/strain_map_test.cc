#include "report/strain_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "tissue/test_soft_block.h"

namespace palpate::report {
namespace {

using ::testing::HasSubstr;

TEST(StrainMap, ColoursDeformedTissueByStrain) {
  const auto model = palpate::testing::soft_block(true);
  const DisplacedTissue deformed(*model, palpate::testing::pressed_at(0, 0));
  const TissueDisplacement moved = [&](const Point<Patient>& at_rest) {
    return deformed.displacement_mm(at_rest);
  };
  SectionStyle style;
  style.moved = moved;
  const SectionPlane plane = anatomical_section(AnatomicalPlane::kCoronal, {0, 0, -8}, 50, 100, 100);
  const auto labels = section_labels(*model, plane, style);
  const StrainMap map = strain_map(*model, deformed, moved, plane, labels);
  EXPECT_GT(map.most, 5 * kMinStrain);
  EXPECT_LT(map.most, 1);

  // at the tool the tissue is dented, at rest it is not
  const auto pixel_at = [&](double x, double z) {
    const auto [column, row] = plane.pixel_of({x, 0, z});
    return static_cast<std::size_t>(row + 0.5) * 100 + static_cast<std::size_t>(column + 0.5);
  };
  EXPECT_EQ(section_labels(*model, plane)[pixel_at(0, -0.7)], 1);
  EXPECT_EQ(labels[pixel_at(0, -0.7)], 0);
  const auto alpha = [&](std::size_t pixel) { return map.picture.rgba[4 * pixel + 3]; };
  const auto light = [&](std::size_t pixel) {
    const std::uint8_t* rgb = &map.picture.rgba[4 * pixel];
    return rgb[0] + rgb[1] + rgb[2];
  };
  // the hard ball is darker than what is pressed onto it; air, bone and distant tissue have no overlay
  EXPECT_EQ(labels[pixel_at(0, -9)], 2);
  EXPECT_LT(light(pixel_at(0, -9)), light(pixel_at(0, -4)) / 2);
  EXPECT_GT(alpha(pixel_at(0, -4)), 200);
  for (const std::size_t pixel : {pixel_at(0, -0.7), pixel_at(10, 4), pixel_at(0, -22), pixel_at(24, -18)})
    EXPECT_LT(alpha(pixel), 60) << pixel;

  std::set<std::array<std::uint8_t, 4>> colours;
  for (std::size_t n = 0; n < map.picture.rgba.size(); n += 4)
    colours.insert(
        {map.picture.rgba[n], map.picture.rgba[n + 1], map.picture.rgba[n + 2], map.picture.rgba[n + 3]});
  EXPECT_LE(colours.size(), 256u) << "a PNG with a palette";
  EXPECT_GT(colours.size(), 10u);
}

TEST(StrainMap, ScaleSpansZeroToMaximum) {
  const std::string svg = strain_scale_svg();
  EXPECT_THAT(svg, HasSubstr("<stop offset=\"0%\" stop-color=\"#000004\"/>"));
  EXPECT_THAT(svg, HasSubstr("<stop offset=\"100%\" stop-color=\"#fcffa4\"/>"));
  EXPECT_THAT(svg, HasSubstr("25 %"));
}

}  // namespace
}  // namespace palpate::report
