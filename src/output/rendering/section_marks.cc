#include "rendering/section_marks.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "palpate/contact/colours.h"
#include "palpate/rendering/markup.h"
#include "rendering/bitmap_font.h"
#include "rendering/marks.h"

namespace palpate::section_marks {
namespace {

constexpr Rgb kText{238, 240, 242}, kDim{190, 196, 202}, kWarning{255, 196, 64}, kMark{90, 220, 255};
constexpr Rgb kDark{0, 0, 0};
constexpr const char* kPurpose = "Research and education - not for clinical use";
/// Draws in units of a glyph's dot, so that pictures of any size look alike.
class Pen {
 public:
  explicit Pen(Image& image)
      : image_(image), unit_(std::max(1, std::min(image.width, image.height) / kUnitsAcross)) {}

  int unit() const { return unit_; }
  int margin() const { return 5 * unit_; }
  int line() const { return (bitmap_font::kHeight + 2) * unit_; }
  int width() const { return image_.width; }
  int height() const { return image_.height; }

  void text(int left, int top, const std::string& what, const Rgb& colour, int scale = 1) {
    bitmap_font::draw(image_, left, top, what, scale * unit_, colour);
  }
  void text_ending_at(int right, int top, const std::string& what, const Rgb& colour) {
    text(right - width_of(what), top, what, colour);
  }
  int width_of(const std::string& what, int scale = 1) const {
    return bitmap_font::width_px(what, scale * unit_);
  }

  void fill(int left, int top, int right, int bottom, const Rgb& colour) {
    for (int y = std::max(0, top); y < std::min(bottom, height()); ++y) {
      for (int x = std::max(0, left); x < std::min(right, width()); ++x) {
        std::uint8_t* pixel = &image_.rgb[3 * (static_cast<std::size_t>(y) * image_.width + x)];
        pixel[0] = colour.r;
        pixel[1] = colour.g;
        pixel[2] = colour.b;
      }
    }
  }
  /// Bars with a common dark outline.
  struct Bar {
    int left, top, right, bottom;
  };
  void bars(std::initializer_list<Bar> bars, const Rgb& colour) {
    for (const Bar& b : bars) fill(b.left - unit_, b.top - unit_, b.right + unit_, b.bottom + unit_, kDark);
    for (const Bar& b : bars) fill(b.left, b.top, b.right, b.bottom, colour);
  }

 private:
  static constexpr int kUnitsAcross = 384;
  Image& image_;
  int unit_;
};

void draw_letters(Pen& pen, const SectionPlane& plane) {
  constexpr int kScale = 2;
  const OrientationLetters letters = orientation_letters(plane);
  const int high = kScale * bitmap_font::kBaseline * pen.unit(), edge = pen.margin();
  const int middle_y = (pen.height() - high) / 2;
  const auto middle_x = [&](const std::string& text) {
    return (pen.width() - pen.width_of(text, kScale)) / 2;
  };
  pen.text(edge, middle_y, letters.left, kText, kScale);
  pen.text(pen.width() - edge - pen.width_of(letters.right, kScale), middle_y, letters.right, kText, kScale);
  pen.text(middle_x(letters.top), edge, letters.top, kText, kScale);
  pen.text(middle_x(letters.bottom), pen.height() - edge - high, letters.bottom, kText, kScale);
}

void draw_side(Pen& pen, const Model& model) {
  const bool known = model.oriented && model.side != Side::kUnknown;
  pen.text(pen.margin(), pen.margin(), markup::side_mark(model.side, model.oriented),
           known ? kText : kWarning);
  int top = pen.margin();
  for (const std::string& mark : markup::doubt_marks(model))
    pen.text(pen.margin(), top += pen.line(), mark, kWarning);
}

void draw_position(Pen& pen, const SectionPlane& plane, const Model& model, const Caption& caption) {
  const int right = pen.width() - pen.margin();
  int top = pen.margin();
  if (model.oriented) {
    pen.text_ending_at(right, top, caption.plane, kText);
    top += pen.line();
  }
  pen.text_ending_at(right, top, marks::point_text(plane.centre) + " mm LPS", kDim);
  if (model.scan == nullptr || model.scan->empty() || caption.window[0] == caption.window[1]) return;
  char text[80];
  std::snprintf(text, sizeof text, "W %.4g L %.4g", caption.window[1] - caption.window[0],
                0.5 * (caption.window[0] + caption.window[1]));
  pen.text_ending_at(right, top + pen.line(), text, kDim);
}

void draw_scale_bar(Pen& pen, const SectionPlane& plane) {
  const double bar_mm = marks::scale_bar_mm(plane.width_mm);
  const int length = static_cast<int>(std::lround(bar_mm / plane.mm_per_px())), unit = pen.unit();
  const int right = pen.width() - pen.margin(), left = right - length,
            y = pen.height() - pen.margin() - 4 * unit;
  pen.bars({{left, y, right, y + unit},
            {left, y - 3 * unit, left + unit, y + 4 * unit},
            {right - unit, y - 3 * unit, right, y + 4 * unit}},
           kText);
  char text[40];
  std::snprintf(text, sizeof text, "%g mm", bar_mm);
  pen.text(left + (length - pen.width_of(text)) / 2, y - 4 * unit - bitmap_font::kBaseline * unit - unit,
           text, kText);
}

/// From the bottom up: the note on the purpose, in two lines if necessary, then the structures.
void draw_foot(Pen& pen, const SectionPlane& plane, const Model& model, const Caption& caption) {
  constexpr std::size_t kMaxStructures = 8, kMaxName = 32;
  const int left = pen.margin(), unit = pen.unit();
  const int bar = static_cast<int>(marks::scale_bar_mm(plane.width_mm) / plane.mm_per_px());
  int top = pen.height() - pen.margin() - bitmap_font::kBaseline * unit;
  // space for the letter at the centre of the lower edge, and for the scale bar
  const int letters = pen.width_of("XXX", 2);
  const int room = model.oriented ? (pen.width() - letters) / 2 : pen.width() - bar - 4 * pen.margin();
  std::string purpose = kPurpose;
  if (left + pen.width_of(purpose) > room) {
    const std::size_t half = purpose.find("- ");
    pen.text(left, top, purpose.substr(half + 2), kText);
    purpose.resize(half + 1);
    top -= pen.line();
  }
  pen.text(left, top, purpose, kText);
  top -= pen.line() + 3 * unit;

  const std::size_t count = std::min(caption.structures.size(), kMaxStructures);
  for (std::size_t n = count; n-- > 0; top -= pen.line()) {
    pen.bars({{left, top, left + 7 * unit, top + 7 * unit}}, colour_of(model, caption.structures[n]));
    pen.text(left + 11 * unit, top, marks::short_name(model, caption.structures[n], kMaxName), kDim);
  }
}

/// Cross with a gap at the point itself; with a direction down the picture, dashes that lead to the point.
void draw_point(Pen& pen, bool has_direction) {
  const int unit = pen.unit(), x = pen.width() / 2 - unit / 2, y = pen.height() / 2 - unit / 2;
  const int from = 4 * unit, to = 12 * unit;
  pen.bars({{x - to, y, x - from, y + unit},
            {x + from + unit, y, x + to + unit, y + unit},
            {x, y - to, x + unit, y - from},
            {x, y + from + unit, x + unit, y + to + unit}},
           kMark);
  if (!has_direction) return;
  for (int dash = to + 4 * unit; dash < pen.height() / 4; dash += 8 * unit)
    pen.bars({{x, y - dash - 4 * unit, x + unit, y - dash}}, kMark);
}

}  // namespace

void draw_marks(Image& image, const SectionPlane& plane, const Model& model, const Caption& caption) {
  Pen pen(image);
  if (caption.has_point) draw_point(pen, caption.has_direction);
  if (model.oriented) draw_letters(pen, plane);
  draw_side(pen, model);
  draw_position(pen, plane, model, caption);
  if (caption.has_scale) draw_scale_bar(pen, plane);
  draw_foot(pen, plane, model, caption);
}

void draw_frame(Image& image, const Rgb& colour) {
  Pen pen(image);
  const int w = image.width, h = image.height, thick = pen.unit();
  pen.fill(0, 0, w, thick, colour);
  pen.fill(0, h - thick, w, h, colour);
  pen.fill(0, 0, thick, h, colour);
  pen.fill(w - thick, 0, w, h, colour);
}

}  // namespace palpate::section_marks
