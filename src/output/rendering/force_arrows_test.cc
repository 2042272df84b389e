#include "palpate/rendering/force_arrows.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <limits>
#include <regex>
#include <sstream>

#include "base/test_folder.h"
#include "contact/test_model.h"
#include "palpate/direct/direct_methods.h"

namespace palpate::force_arrows {
namespace {

using palpate::testing::ball_model;
using palpate::testing::kBone;
using palpate::testing::kBoneRadius_mm;
using palpate::testing::with_every_method;
using ::testing::HasSubstr;

constexpr AnatomicalPlane kPlanes[] = {AnatomicalPlane::kAxial, AnatomicalPlane::kCoronal,
                                       AnatomicalPlane::kSagittal};

/// Arrow as drawn on the page.
struct Drawn {
  Pixel tail{}, tip{};
  bool hollow = false;

  Pixel middle() const { return {0.5 * (tail[0] + tip[0]), 0.5 * (tail[1] + tip[1])}; }
  Pixel along() const { return {tip[0] - tail[0], tip[1] - tail[1]}; }
  double length() const { return std::hypot(along()[0], along()[1]); }
};

/// Arrows of the field; those of the scale are to the right of the section.
std::vector<Drawn> arrows_of(const std::string& svg) {
  const std::regex form(
      R"(<path class="arrow( hollow)?" color="#[0-9a-f]{6}" d="M(\S+) (\S+)L\S+ \S+M\S+ \S+L(\S+) (\S+)L.*Z"/>)");
  std::vector<Drawn> arrows;
  std::istringstream lines(svg);
  for (std::string line; std::getline(lines, line);) {
    std::smatch found;
    if (!line.starts_with("<path class=\"arrow") || !std::regex_match(line, found, form)) continue;
    Drawn arrow{{std::stod(found[2]), std::stod(found[3])},
                {std::stod(found[4]), std::stod(found[5])},
                found[1].matched};
    if (arrow.middle()[0] < 580) arrows.push_back(arrow);
  }
  return arrows;
}

/// Corner of the section on the page, and the plane that it shows.
struct Page {
  Pixel corner{};
  SectionPlane plane;

  Page(const std::string& svg, const ForceArrowsRequest& request)
      : plane(anatomical_section(request.plane, request.centre, request.size_mm, kSection_px, kSection_px)) {
    std::smatch found;
    EXPECT_TRUE(
        std::regex_search(svg, found, std::regex("<image class=\"section\" x=\"(\\S+)\" y=\"(\\S+)\"")));
    corner = {std::stod(found[1]), std::stod(found[2])};
  }
  Pixel pixel_of(const Point<Patient>& p) const {
    const Pixel pixel = plane.pixel_of(p);
    return {corner[0] + pixel[0] + 0.5, corner[1] + pixel[1] + 0.5};
  }
  Point<Patient> point_at(const Pixel& pixel) const {
    return plane.at(pixel[0] - corner[0] - 0.5, pixel[1] - corner[1] - 0.5);
  }
};

/// 25 x 25 arrows, so that one is at the centre.
ForceArrowsRequest request_at(AnatomicalPlane plane, const Point<Patient>& centre, double size_mm = 20) {
  return {plane, centre, size_mm, size_mm / 25};
}

std::string draw(const Model& model, const ForceArrowsRequest& request,
                 ForceMethod method = ForceMethod::kTrilinear) {
  const auto svg = force_arrows_svg(model, method, request);
  EXPECT_TRUE(svg.ok()) << svg.error().message();
  return *svg;
}

/// Assertion that does not print the whole document on failure.
::testing::AssertionResult says(const std::string& svg, const std::string& part) {
  if (svg.find(part) != std::string::npos) return ::testing::AssertionSuccess() << "it says " << part;
  return ::testing::AssertionFailure() << "it does not say " << part;
}

Drawn middle_arrow(const std::string& svg, const Page& page) {
  const Pixel middle = page.pixel_of(page.plane.centre);
  for (const Drawn& arrow : arrows_of(svg))
    if (std::hypot(arrow.middle()[0] - middle[0], arrow.middle()[1] - middle[1]) < 0.1) return arrow;
  ADD_FAILURE() << "no arrow in the middle";
  return {};
}

// length on the page of a force, by the documented scale
double expected_length(double in_plane_N, double force_N, double full_N) {
  return 0.95 * kSection_px / 25 * std::sqrt(std::min(1.0, force_N / full_N)) * in_plane_N / force_N;
}

TEST(ForceArrows, PointOutwardAtTheSurfaceOfABall) {
  const Model model = ball_model();
  constexpr double r = kBoneRadius_mm;
  const struct {
    AnatomicalPlane plane;
    Point<Patient> at;
    Pixel along;  // across, down
  } cases[] = {
      // the patient's left is on picture right
      {AnatomicalPlane::kAxial, {r, 0, 0}, {1, 0}},     {AnatomicalPlane::kAxial, {-r, 0, 0}, {-1, 0}},
      {AnatomicalPlane::kAxial, {0, -r, 0}, {0, -1}},   {AnatomicalPlane::kCoronal, {r, 0, 0}, {1, 0}},
      {AnatomicalPlane::kCoronal, {0, 0, r}, {0, -1}},  {AnatomicalPlane::kSagittal, {0, -r, 0}, {-1, 0}},
      {AnatomicalPlane::kSagittal, {0, 0, -r}, {0, 1}},
  };
  for (const auto& c : cases) {
    SCOPED_TRACE(::testing::Message() << static_cast<int>(c.plane) << " at " << c.at.eigen().transpose());
    const auto request = request_at(c.plane, c.at);
    const std::string svg = draw(model, request);
    const Drawn arrow = middle_arrow(svg, Page(svg, request));
    // half of the full force at the surface; tolerance for voxels and rounding to a hundredth of a pixel
    EXPECT_NEAR(arrow.length(), expected_length(1, 1, 2), 0.3);
    EXPECT_GT((arrow.along()[0] * c.along[0] + arrow.along()[1] * c.along[1]) / arrow.length(), 0.999);
    EXPECT_FALSE(arrow.hollow);
  }
}

TEST(ForceArrows, EveryArrowIsTheForceAtItsMiddle) {
  const Model model = with_every_method(ball_model({0.6, 0.6, 0.9}, 1.0, 2.0));
  for (const ForceMethodInfo& info : kDirectMethods) {
    const ForceField& field = model.force_field(info.method);
    for (const AnatomicalPlane plane : kPlanes) {
      SCOPED_TRACE(info.name);
      const auto request = request_at(plane, {9, -8, 7});
      const std::string svg = draw(model, request, info.method);
      const Page page(svg, request);
      const Vector<Patient> away = page.plane.right.cross(page.plane.down);
      std::size_t near = 0;
      for (const Drawn& arrow : arrows_of(svg)) {
        // a piecewise constant field may change within a hundredth of a pixel
        const FieldSample sample = field.sample(page.point_at(arrow.middle()));
        const Vector<Patient> force = normal_force(sample, field.full_force_N());
        const double right = force.dot(page.plane.right), down = force.dot(page.plane.down);
        const double in_plane = std::hypot(right, down), out = std::abs(force.dot(away));
        const double length = expected_length(in_plane, force.norm(), field.full_force_N());
        const double off = std::hypot(arrow.along()[0] - length * right / in_plane,
                                      arrow.along()[1] - length * down / in_plane);
        near += off < 0.05 && arrow.hollow == (out > 0.5 * force.norm());
      }
      EXPECT_GT(arrows_of(svg).size(), 200u);
      EXPECT_GE(static_cast<double>(near), 0.97 * static_cast<double>(arrows_of(svg).size()));
    }
  }
}

TEST(ForceArrows, MarksForcesOutOfThePlane) {
  const Model model = ball_model();
  // axial sections are viewed from the feet: superior is away from the viewer
  const auto above = request_at(AnatomicalPlane::kAxial, {0, 0, kBoneRadius_mm});
  const auto below = request_at(AnatomicalPlane::kAxial, {0, 0, -kBoneRadius_mm});
  const std::string cross = draw(model, above), dot = draw(model, below);
  EXPECT_TRUE(says(cross, "d=\"M299.9 345.9l4.2 4.2M304.1 345.9l-4.2 4.2\"/>"));
  EXPECT_TRUE(says(dot, "d=\"M299 348a3 3 0 1 0 6 0a3 3 0 1 0 -6 0Z\"/>\n<path class=\"dot\""));
  EXPECT_FALSE(says(dot, "l4.2 4.2"));
  // near the pole all forces are normal to the section
  for (const Drawn& arrow : arrows_of(cross)) {
    const Pixel at = arrow.middle();
    EXPECT_TRUE(arrow.hollow || std::hypot(at[0] - 302, at[1] - 348) > 150);
  }
  // none is normal in a section through the centre
  for (const Drawn& arrow : arrows_of(draw(model, request_at(AnatomicalPlane::kAxial, {15, 0, 0}))))
    EXPECT_FALSE(arrow.hollow);
}

TEST(ForceArrows, LettersStandWherePatientsSidesAre) {
  const Model model = ball_model();
  const auto letters = [&](AnatomicalPlane plane) {
    const std::string svg = draw(model, request_at(plane, {15, 0, 0}));
    std::string at_edges = "????";
    const std::regex form("<text class=\"letter\" x=\"([^\"]+)\" y=\"([^\"]+)\">([A-Z])</text>");
    for (std::sregex_iterator found(svg.begin(), svg.end(), form), end; found != end; ++found) {
      const double x = std::stod((*found)[1]), y = std::stod((*found)[2]);
      const std::size_t edge = x < 32 ? 0 : x > 572 ? 1 : y < 78 ? 2 : 3;
      at_edges[edge] = (*found)[3].str()[0];
    }
    return at_edges;
  };
  // left, right, top, bottom
  EXPECT_EQ(letters(AnatomicalPlane::kAxial), "RLAP");
  EXPECT_EQ(letters(AnatomicalPlane::kCoronal), "RLSI");
  EXPECT_EQ(letters(AnatomicalPlane::kSagittal), "APSI");
}

// letters are exact on any grid, because the section lies along the patient's axes
TEST(ForceArrows, AnObliqueGridIsSampledAlongThePatientsAxes) {
  Model model = ball_model();
  const auto turned = Rotation<Patient, Patient>::about(Eigen::Vector3d(1, 2, 3).normalized(), 0.5);
  std::visit(
      [&](auto volume) {
        GridGeometry grid = volume.geometry();
        grid.direction = turned.quaternion().toRotationMatrix();
        grid.origin = Point<Patient>(Eigen::Vector3d(grid.direction * grid.origin.eigen()));
        using Voxels = decltype(volume);
        model.field = std::make_shared<const Field>(Voxels(grid, volume.voxels()));
        model.labels = label_bricks(Volume<LabelId>(grid, model.labels->dense().voxels()));
      },
      model.field->storage());
  model.methods[0] = *make_force_field(model, ForceMethod::kTrilinear);
  for (const AnatomicalPlane plane : kPlanes) {
    const auto request = request_at(plane, {0, 0, 0}, 40);
    const std::string svg = draw(model, request);
    const Page page(svg, request);
    const Pixel middle = page.pixel_of({});
    int observed = 0;
    for (const Drawn& arrow : arrows_of(svg)) {
      const double x = arrow.middle()[0] - middle[0], y = arrow.middle()[1] - middle[1];
      const double distance_mm = std::hypot(x, y) * page.plane.mm_per_px();
      if (std::abs(distance_mm - kBoneRadius_mm) > 1) continue;
      ++observed;
      const double cosine =
          (arrow.along()[0] * x + arrow.along()[1] * y) / (arrow.length() * std::hypot(x, y));
      EXPECT_GT(cosine, std::cos(3 * 3.14159265358979323846 / 180));
    }
    EXPECT_GT(observed, 40);
    EXPECT_TRUE(says(svg, "class=\"letter\""));
  }
}

TEST(ForceArrows, LinesOfEqualValueAreCirclesRoundABall) {
  const Model model = ball_model({0.5, 0.5, 0.5});
  const ForceField& field = model.force_field(ForceMethod::kTrilinear);
  const SectionPlane plane = anatomical_section(AnatomicalPlane::kCoronal, {}, 50, kSection_px, kSection_px);
  const ValueGrid grid(field, plane, 135);
  for (const double level : {0.25, 0.5, 0.75}) {
    double length_mm = 0, radius_mm = 0;
    for (const ContourSegment& segment : grid.contour(level)) {
      const Vector<Patient> from = plane.at(segment.from[0], segment.from[1]) - Point<Patient>();
      const Vector<Patient> to = plane.at(segment.to[0], segment.to[1]) - Point<Patient>();
      EXPECT_NEAR(field.sample(Point<Patient>(from.eigen())).value, level, 0.02);
      if (radius_mm == 0) radius_mm = from.norm();
      EXPECT_NEAR(from.norm(), radius_mm, 0.05);
      length_mm += (to - from).norm();
    }
    // closed, with a winding number of one
    EXPECT_NEAR(length_mm, 2 * 3.14159265358979323846 * radius_mm, 0.5);
    // radius at which a Gaussian-smoothed step of 1 mm has that value
    const double offset_mm = level == 0.5 ? 0 : level < 0.5 ? 0.6745 : -0.6745;
    EXPECT_NEAR(radius_mm, kBoneRadius_mm + offset_mm, 0.05);
  }
  EXPECT_TRUE(grid.contour(2).empty());
}

TEST(ForceArrows, ArrowsFillTheSectionWithoutLeavingIt) {
  const SectionPlane plane = anatomical_section(AnatomicalPlane::kAxial, {}, 20, kSection_px, kSection_px);
  const Model model = ball_model();
  const ForceField& field = model.force_field(ForceMethod::kTrilinear);
  EXPECT_EQ(sample_arrows(field, plane, 20.0 / 24).size(), 576u);
  EXPECT_EQ(sample_arrows(field, plane, 30).size(), 1u);
  EXPECT_EQ(arrows_per_side(20, 0.1), 200);
  for (const double spacing_mm : {0.5, 20.0 / 24, 0.83, 3.0, 30.0}) {
    Pixel low{1e9, 1e9}, high{-1e9, -1e9};
    for (const Arrow& arrow : sample_arrows(field, plane, spacing_mm))
      for (int axis = 0; axis < 2; ++axis) {
        low[axis] = std::min(low[axis], arrow.at[axis]);
        high[axis] = std::max(high[axis], arrow.at[axis]);
      }
    for (int axis = 0; axis < 2; ++axis) {
      EXPECT_NEAR(low[axis] + high[axis], kSection_px - 1, 1e-9);
      EXPECT_LE(high[axis] - low[axis] + std::min(20.0, spacing_mm) * 27, kSection_px + 1e-6);
    }
  }
}

TEST(ForceArrows, PageDescribesItsContents) {
  Model model = with_every_method(ball_model());
  model.title = "CANARY";
  const auto request = request_at(AnatomicalPlane::kSagittal, {-3.25, 8.04, -12});
  for (const ForceMethodInfo& info : kDirectMethods) {
    const std::string svg = draw(model, request, info.method);
    SCOPED_TRACE(info.name);
    char full[40];
    std::snprintf(full, sizeof full, "F_full %.2f N", model.force_field(info.method).full_force_N());
    for (const std::string& part : {std::string(info.name), std::string(info.about), std::string(full),
                                    std::string("sagittal section, centre -3.2, 8.0, -12.0 mm (LPS)"),
                                    std::string("Research and education \u2014 not for clinical use"),
                                    std::string("5 mm"), std::string("data:image/png;base64,iVBORw0KGgo")})
      EXPECT_TRUE(says(svg, part));
    const bool in_voxels = info.method == ForceMethod::kGaussianSphere;
    EXPECT_TRUE(says(svg, in_voxels ? "\u03c3 1 voxel (0.6 mm)" : "\u03c3 1 mm"));
    EXPECT_FALSE(says(svg, "CANARY"));
  }
}

TEST(ForceArrows, LabelsTheSide) {
  Model model = ball_model();
  const auto request = request_at(AnatomicalPlane::kAxial, {15, 0, 0});
  EXPECT_TRUE(says(draw(model, request), ">SIDE UNKNOWN</text>"));
  model.side = Side::kLeft;
  EXPECT_TRUE(says(draw(model, request), ">Side: LEFT</text>"));
  model.side = Side::kRight;
  EXPECT_TRUE(says(draw(model, request), ">Side: RIGHT</text>"));
  model.side = Side::kBoth;
  EXPECT_FALSE(says(draw(model, request), "SIDE"));
  // letters would claim an orientation that the files do not contain
  model.oriented = false;
  EXPECT_TRUE(says(draw(model, request), ">ORIENTATION UNKNOWN</text>"));
  EXPECT_FALSE(says(draw(model, request), "class=\"letter\""));
}

TEST(ForceArrows, NamesFromFilesStayText) {
  Model model = ball_model();
  const auto request = request_at(AnatomicalPlane::kAxial, {15, 0, 0});
  const auto with_name = [&](const std::string& name) {
    model.segments.front().name = name;
    return draw(model, request);
  };
  EXPECT_TRUE(says(with_name("a <b> & \"c\""), ">a &lt;b&gt; &amp; &quot;c&quot;</text>"));
  const std::string number = ">label " + std::to_string(kBone) + "</text>";
  EXPECT_TRUE(says(with_name("no text \xff\xfe"), number));
  EXPECT_TRUE(says(with_name("bell\x07"), number));
  EXPECT_TRUE(says(with_name(std::string(300, 'n')), number));
  EXPECT_TRUE(says(with_name(""), number));
}

TEST(ForceArrows, RejectsInvalidViews) {
  const Model model = ball_model();
  auto request = request_at(AnatomicalPlane::kAxial, {500, 0, 0});
  auto refused = force_arrows_svg(model, ForceMethod::kTrilinear, request);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().kind, ErrorKind::kBadInput);
  EXPECT_THAT(refused.error().what, HasSubstr("500.0, 0.0, 0.0 mm lies outside the volume"));
  EXPECT_THAT(refused.error().remedy, HasSubstr("reaches from -30.3, -30.3, -30.1 to 30.3"));
  request.centre = Point<Patient>(std::numeric_limits<double>::quiet_NaN(), 0, 0);
  EXPECT_FALSE(force_arrows_svg(model, ForceMethod::kTrilinear, request).ok());

  request = {AnatomicalPlane::kAxial, {}, 20, 0.0999};
  EXPECT_TRUE(force_arrows_svg(model, ForceMethod::kTrilinear, request).ok());
  request.spacing_mm = 0.0995;
  refused = force_arrows_svg(model, ForceMethod::kTrilinear, request);
  ASSERT_FALSE(refused.ok());
  EXPECT_THAT(refused.error().what, HasSubstr("201 x 201 arrows, and at most 200 x 200"));
  request.spacing_mm = 1e-300;
  EXPECT_FALSE(force_arrows_svg(model, ForceMethod::kTrilinear, request).ok());
}

TEST(ForceArrows, AreWrittenAtomically) {
  const test::TemporaryFolder folder;
  const Model model = ball_model();
  const auto request = request_at(AnatomicalPlane::kAxial, {15, 0, 0});
  const auto file = folder / "forces.svg";
  ASSERT_TRUE(write_force_arrows(file, model, ForceMethod::kTrilinear, request).ok());
  EXPECT_EQ(test::bytes_of_file(file), draw(model, request));
  const auto nowhere =
      write_force_arrows(folder.path() / "missing" / "f.svg", model, ForceMethod::kTrilinear, request);
  ASSERT_FALSE(nowhere.ok());
  EXPECT_EQ(nowhere.error().kind, ErrorKind::kOutput);
}

}  // namespace
}  // namespace palpate::force_arrows
