#include <algorithm>
#include <cmath>

#include "indentation/format.h"
#include "palpate/indentation/indentation.h"
#include "palpate/rendering/force_arrows_svg.h"
#include "palpate/scene/named_values.h"

namespace palpate {
namespace {

using force_arrows::pair, force_arrows::path, force_arrows::rectangle, force_arrows::text;

constexpr double kWidth_px = 720, kHeight_px = 460, kLeft_px = 64, kTop_px = 48, kPlot_px = 620,
                 kDown_px = 350;
constexpr std::size_t kMaxDots = 2000;
constexpr const char* kStyle =
    "<style>\n"
    "text{font-family:Helvetica,Arial,sans-serif;font-size:13px;fill:#222}\n"
    ".name{font-size:16px;font-weight:bold}.small,.end,.middle{font-size:12px}.end{text-anchor:end}\n"
    ".middle{text-anchor:middle}.page{fill:#fff}.frame,.tick{fill:none;stroke:#555}.dots{fill:#9cc9e8}\n"
    ".line{fill:none;stroke:#888;stroke-width:1;stroke-dasharray:5 4}\n"
    ".best{fill:none;stroke:#b12a90;stroke-width:1.8;stroke-linejoin:round}\n"
    "</style>\n";

// smallest of 1, 2 and 5 times a power of ten that is not less
double round_up(double value) {
  const double power = std::pow(10, std::floor(std::log10(value)));
  for (const double factor : {1.0, 2.0, 5.0})
    if (factor * power >= value) return factor * power;
  return 10 * power;
}

struct Axes {
  double low_mm, high_mm, high_N;

  force_arrows::Pixel at(double depth_mm, double force_N) const {
    return {kLeft_px + kPlot_px * (depth_mm - low_mm) / (high_mm - low_mm),
            kTop_px + kDown_px * (1 - std::clamp(force_N / high_N, -0.02, 1.02))};
  }
};

std::string axes_svg(const Axes& axes) {
  std::string svg = rectangle("frame", {kLeft_px, kTop_px}, kPlot_px, kDown_px);
  constexpr double kTicks = 5;
  const double step_mm = round_up((axes.high_mm - axes.low_mm) / kTicks),
               step_N = round_up(axes.high_N / kTicks);
  for (double mm = std::ceil(axes.low_mm / step_mm) * step_mm; mm <= axes.high_mm; mm += step_mm) {
    const auto at = axes.at(mm, 0);
    svg +=
        path("tick", "M" + pair({at[0], kTop_px + kDown_px}) + "v4") +
        text("middle", {at[0], kTop_px + kDown_px + 18}, printed("%g", std::round(mm / step_mm) * step_mm));
  }
  for (double force_N = 0; force_N <= axes.high_N; force_N += step_N) {
    const auto at = axes.at(axes.low_mm, force_N);
    svg += path("tick", "M" + pair({kLeft_px - 4, at[1]}) + "h4") +
           text("end", {kLeft_px - 7, at[1] + 4}, printed("%.3g", force_N));
  }
  return svg + text("middle", {kLeft_px + 0.5 * kPlot_px, kTop_px + kDown_px + 38}, "depth, mm") +
         text("small", {kLeft_px, kTop_px - 8}, "force, N");
}

// curves of one law, in the order in which the samples were taken
std::string law_svg(std::span<const IndentationCurve> curves, const TissueFit& fit, const LawFit& law,
                    const Axes& axes, const char* css_class) {
  std::string data;
  for (std::size_t c = 0; c < curves.size(); ++c) {
    const std::vector<double> force_N = fitted_forces_N(law, fit.poissons_ratio, curves[c], c);
    bool pen_down = false;
    const std::size_t every = force_N.size() / kMaxDots + 1;
    for (std::size_t n = 0; n < force_N.size(); n += every) {
      if (!std::isfinite(force_N[n])) {
        pen_down = false;
        continue;
      }
      data += (pen_down ? "L" : "M") + pair(axes.at(curves[c].depth_mm[n], force_N[n]));
      pen_down = true;
    }
  }
  return path(css_class, data);
}

}  // namespace

std::string fit_svg(std::span<const IndentationCurve> curves, const TissueFit& fit) {
  Axes axes{0, 0, 0};
  std::size_t samples = 0;
  for (const IndentationCurve& curve : curves) {
    samples += curve.depth_mm.size();
    axes.low_mm = std::min(axes.low_mm, *std::ranges::min_element(curve.depth_mm));
    axes.high_mm = std::max(axes.high_mm, *std::ranges::max_element(curve.depth_mm));
    axes.high_N = std::max(axes.high_N, *std::ranges::max_element(curve.force_N));
  }
  axes.high_N *= 1.05;
  const std::size_t every = samples / kMaxDots + 1;
  std::string dots;
  for (const IndentationCurve& curve : curves)
    for (std::size_t n = 0; n < curve.depth_mm.size(); n += every) {
      const auto at = axes.at(curve.depth_mm[n], curve.force_N[n]);
      dots += "M" + pair({at[0] - 2, at[1]}) + "a2 2 0 1 0 4 0a2 2 0 1 0 -4 0";
    }
  std::string svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " + printed("%g", kWidth_px) +
                    " " + printed("%g", kHeight_px) +
                    "\" role=\"img\" aria-label=\"Measured and fitted force against "
                    "depth\">\n" +
                    kStyle + rectangle("page", {0, 0}, kWidth_px, kHeight_px) + path("dots", dots);
  for (std::size_t n = 0; n < fit.laws.size(); ++n)
    if (n != fit.chosen) svg += law_svg(curves, fit, fit.laws[n], axes, "line");
  svg += law_svg(curves, fit, fit.best(), axes, "best") + axes_svg(axes);
  const LawFit& best = fit.best();
  svg += text(
      "name", {kLeft_px, 24},
      std::string(name_of(best.law, kTissueLaws)) + printed(": E %.3g kPa", best.youngs_modulus_kPa.value) +
          (best.law == TissueLaw::kExponential ? printed(", stiffening %.3g", best.stiffening.value) : "") +
          printed("; residuals %.2g %%", best.rms_percent));
  return svg +
         text("small", {kLeft_px, kHeight_px - 10},
              "dots: measured; solid line: the chosen law; dashed: the other laws") +
         "</svg>\n";
}

}  // namespace palpate
