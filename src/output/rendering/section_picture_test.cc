#include "rendering/section_marks.h"

#include <gtest/gtest.h>

#include <set>

#include "rendering/bitmap_font.h"
#include "rendering/marks.h"

namespace palpate {
namespace {

constexpr Rgb kFemurColour{220, 40, 30};

/// A ball of femur in the centre of an empty box of 100 mm, with a constant scan.
Model ball() {
  GridGeometry grid;
  grid.dims = {50, 50, 50};
  grid.spacing_mm = {2, 2, 2};
  Volume<LabelId> labels(grid);
  for (int k = 15; k < 35; ++k)
    for (int j = 15; j < 35; ++j)
      for (int i = 15; i < 35; ++i) labels.at(i, j, k) = 95;
  Model model;
  model.labels = label_bricks(labels);
  model.scan = std::make_shared<const Volume<float>>(grid, 0.0f);
  model.segments = {{95, "femur", kFemurColour, 0, 95}};
  model.title = "CANARY";
  model.side = Side::kLeft;
  return model;
}

SectionRequest request_for(const Model& model, SectionKind kind) {
  SectionRequest request;
  request.kind = kind;
  request.centre = model.labels->geometry().centre();
  request.direction = {1, 1, 0};
  return request;
}

Rgb pixel_of(const Image& image, int x, int y) {
  const std::uint8_t* p = &image.rgb[3 * (static_cast<std::size_t>(y) * image.width + x)];
  return {p[0], p[1], p[2]};
}

struct Box {
  double left = 0, top = 0, right = 1, bottom = 1;  ///< Fractions of the picture
};

/// Whether a text appears in a part of the picture: its dots in one bright colour, and none between them.
bool shows(const Image& image, const std::string& text, const Box& box = {}) {
  for (const int scale : {1, 2, 3, 4, 5}) {
    Image letters{bitmap_font::width_px(text, scale), bitmap_font::kBaseline * scale, {}};
    letters.rgb.assign(3 * static_cast<std::size_t>(letters.width) * letters.height, 9);
    bitmap_font::draw(letters, 0, 0, text, scale, {255, 255, 255});
    const auto is_on = [&](int x, int y) { return pixel_of(letters, x, y).r == 255; };
    std::array<int, 2> first{};
    while (!is_on(first[0], first[1])) {
      if (++first[0] == letters.width) first = {0, first[1] + 1};
    }
    const auto stands_at = [&](int left, int top) {
      const Rgb colour = pixel_of(image, left + first[0], top + first[1]);
      if (colour.g < 150) return false;
      for (int y = 0; y < letters.height; ++y)
        for (int x = 0; x < letters.width; ++x)
          if ((pixel_of(image, left + x, top + y) == colour) != is_on(x, y)) return false;
      return true;
    };
    const int right = static_cast<int>(box.right * image.width) - letters.width;
    const int bottom = static_cast<int>(box.bottom * image.height) - letters.height;
    for (int y = static_cast<int>(box.top * image.height); y <= bottom; ++y)
      for (int x = static_cast<int>(box.left * image.width); x <= right; ++x)
        if (stands_at(x, y)) return true;
  }
  return false;
}

constexpr Box kLeftEdge{0, 0.45, 0.15, 0.55}, kRightEdge{0.85, 0.45, 1, 0.55}, kTopEdge{0.4, 0, 0.6, 0.1},
    kBottomEdge{0.4, 0.9, 0.6, 1};

TEST(SectionPicture, LettersStandOnTheEdges) {
  const Model model = ball();
  const auto expect = [&](SectionKind kind, const char* left, const char* right, const char* top,
                          const char* bottom) {
    const Image image = section_picture(model, request_for(model, kind)).value();
    EXPECT_TRUE(shows(image, left, kLeftEdge)) << left;
    EXPECT_TRUE(shows(image, right, kRightEdge)) << right;
    EXPECT_TRUE(shows(image, top, kTopEdge)) << top;
    EXPECT_TRUE(shows(image, bottom, kBottomEdge)) << bottom;
    EXPECT_FALSE(shows(image, right, kLeftEdge)) << right;
  };
  expect(SectionKind::kAxial, "R", "L", "A", "P");
  expect(SectionKind::kCoronal, "R", "L", "S", "I");
  expect(SectionKind::kSagittal, "A", "P", "S", "I");
  // down the picture is left and posterior in equal parts
  const SectionRequest oblique = request_for(model, SectionKind::kOblique);
  const OrientationLetters letters =
      orientation_letters(oblique_section(oblique.centre, oblique.direction, oblique.view, 100, 768, 768));
  EXPECT_EQ(letters.bottom.size(), 2u);
  expect(SectionKind::kOblique, letters.left.c_str(), letters.right.c_str(), letters.top.c_str(),
         letters.bottom.c_str());
}

TEST(SectionPicture, LabelsTheSideOrUnknown) {
  constexpr Box kCorner{0, 0, 0.4, 0.1};
  Model model = ball();
  const auto marked = [&](const std::string& text) {
    return shows(section_picture(model, request_for(model, SectionKind::kAxial)).value(), text, kCorner);
  };
  EXPECT_TRUE(marked("Side: LEFT"));
  model.side = Side::kRight;
  EXPECT_TRUE(marked("Side: RIGHT"));
  EXPECT_FALSE(marked("LEFT"));
  model.side = Side::kUnknown;
  EXPECT_TRUE(marked("SIDE UNKNOWN"));
  EXPECT_FALSE(marked("LEFT"));
  EXPECT_FALSE(marked("RIGHT"));
  EXPECT_FALSE(marked("PLACEMENT IN DOUBT"));
  model.caveats = {{CaveatKind::kPlacement, "half of the labels lie outside the scan"}};
  EXPECT_TRUE(marked("PLACEMENT IN DOUBT"));
  EXPECT_FALSE(marked("SIDE IN DOUBT"));
  // no caption if both sides were scanned
  model.side = Side::kBoth;
  for (const char* text : {"SIDE", "LEFT", "RIGHT", "Side"}) EXPECT_FALSE(marked(text));
}

TEST(SectionPicture, WithoutOrientationNamesNoDirection) {
  Model model = ball();
  model.oriented = false;
  const Image image = section_picture(model, request_for(model, SectionKind::kCoronal)).value();
  EXPECT_TRUE(shows(image, "ORIENTATION UNKNOWN"));
  for (const Box& edge : {kLeftEdge, kRightEdge, kTopEdge, kBottomEdge})
    for (const char* letter : {"R", "L", "S", "I", "A", "P"})
      EXPECT_FALSE(shows(image, letter, edge)) << letter;
  EXPECT_FALSE(shows(image, "coronal"));
}

TEST(SectionPicture, StatesContentsAndPurpose) {
  const Model model = ball();
  for (const int pixels : {kMinSectionPixels, 512, 768, 1100}) {
    SCOPED_TRACE(pixels);
    SectionRequest request = request_for(model, SectionKind::kCoronal);
    request.pixels = pixels;
    request.style.window_low = -160;
    request.style.window_high = 240;
    const Image image = section_picture(model, request).value();
    EXPECT_EQ(image.width, pixels);
    EXPECT_EQ(image.height, pixels);
    EXPECT_TRUE(shows(image, "not for clinical use", {0, 0.8, 1, 1}));
    EXPECT_TRUE(shows(image, "Research and education -", {0, 0.8, 1, 1}));
    EXPECT_TRUE(shows(image, "coronal"));
    EXPECT_TRUE(shows(image, "49.0, 49.0, 49.0 mm LPS"));
    EXPECT_TRUE(shows(image, "W 400 L 40"));
    EXPECT_TRUE(shows(image, "femur", {0, 0.5, 0.5, 1}));
    EXPECT_TRUE(shows(image, "20 mm", {0.5, 0.9, 1, 1}));
    EXPECT_FALSE(shows(image, "CANARY"));
  }
  // a window only with a scan
  Model labels = model;
  labels.scan = nullptr;
  EXPECT_FALSE(shows(section_picture(labels, request_for(labels, SectionKind::kAxial)).value(), "W "));
}

TEST(SectionPicture, ScaleBarHasItsStatedLength) {
  const Model model = ball();
  for (const double size_mm : {7.0, 40.0, 100.0, 333.0}) {
    SCOPED_TRACE(size_mm);
    SectionRequest request = request_for(model, SectionKind::kAxial);
    request.size_mm = size_mm;
    request.style.outlines = false;
    request.style.label_opacity = 0;
    const Image image = section_picture(model, request).value();
    // the longest bright run in the lowest twentieth, on the right
    int longest = 0;
    for (int y = image.height * 19 / 20; y < image.height; ++y) {
      int run = 0;
      for (int x = image.width * 3 / 5; x < image.width; ++x) {
        run = pixel_of(image, x, y).g > 230 ? run + 1 : 0;
        longest = std::max(longest, run);
      }
    }
    const double bar_mm = marks::scale_bar_mm(size_mm);
    EXPECT_NEAR(longest * size_mm / image.width, bar_mm, 0.51 * size_mm / image.width);
    char text[40];
    std::snprintf(text, sizeof text, "%g mm", bar_mm);
    EXPECT_TRUE(shows(image, text, {0.5, 0.9, 1, 1})) << text;
  }
}

TEST(SectionPicture, ScaleBarsAreRound) {
  EXPECT_EQ(marks::scale_bar_mm(100), 20);
  EXPECT_EQ(marks::scale_bar_mm(81), 20);
  EXPECT_EQ(marks::scale_bar_mm(79), 10);
  EXPECT_EQ(marks::scale_bar_mm(200), 50);
  EXPECT_EQ(marks::scale_bar_mm(41), 10);
  EXPECT_EQ(marks::scale_bar_mm(1.7), 0.2);
}

TEST(SectionPicture, ThreeAreSideBySide) {
  const Model model = ball();
  SectionRequest request = request_for(model, SectionKind::kThree);
  request.pixels = 400;
  const Image image = section_picture(model, request).value();
  EXPECT_EQ(image.width, 1200);
  EXPECT_EQ(image.height, 400);
  EXPECT_TRUE(shows(image, "axial", {0, 0, 0.333, 0.1}));
  EXPECT_TRUE(shows(image, "coronal", {0.334, 0, 0.666, 0.1}));
  EXPECT_TRUE(shows(image, "sagittal", {0.667, 0, 1, 0.1}));
}

TEST(SectionPicture, APointOutsideIsRefused) {
  const Model model = ball();
  SectionRequest request = request_for(model, SectionKind::kAxial);
  request.centre = {500, 0, 0};
  const auto refused = section_picture(model, request);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(refused.error().where, "centre");
}

TEST(BitmapFont, EveryLetterIsItsOwn) {
  std::set<std::vector<std::uint8_t>> visited;
  for (char letter = ' '; letter <= '~'; ++letter) {
    for (const int scale : {1, 2, 3}) {
      Image image{10 * scale, 10 * scale, std::vector<std::uint8_t>(300 * scale * scale, 128)};
      bitmap_font::draw(image, 0, 0, std::string(1, letter), scale, {255, 255, 255});
      EXPECT_TRUE(visited.insert(image.rgb).second) << letter << " at " << scale;
    }
  }
}

TEST(BitmapFont, IsCutOffAtThePicturesEdges) {
  const std::vector<std::uint8_t> grey(3 * 20 * 12, 128);
  for (const int left : {-1000, -3, 0, 17, 1000}) {
    for (const int top : {-1000, -5, 0, 9, 1000}) {
      Image image{20, 12, grey};
      bitmap_font::draw(image, left, top, "Wg\xc3\x9f", 2, {255, 255, 255});
      EXPECT_EQ(image.rgb == grey, std::abs(left) == 1000 || std::abs(top) == 1000);
    }
  }
  EXPECT_EQ(bitmap_font::width_px("", 3), 0);
  EXPECT_EQ(bitmap_font::width_px("ab", 3), 33);
}

}  // namespace
}  // namespace palpate
