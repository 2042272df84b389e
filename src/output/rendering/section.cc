#include <algorithm>
#include <cmath>
#include <numeric>

#include "palpate/rendering/rendering.h"

namespace palpate {
namespace {

/// Letters of the anatomical directions to which `d` points, the nearest axis first. Further axes appear if
/// `d` is more than 20 degrees off the nearest one: the second always, the third if its component exceeds sin
/// 20 degrees.
std::string direction_letters(const Vector<Patient>& d) {
  constexpr double kPi = 3.14159265358979323846;
  const double oblique = 20.0 * kPi / 180.0;
  constexpr char kPositive[] = {'L', 'P', 'S'};
  constexpr char kNegative[] = {'R', 'A', 'I'};

  std::array<int, 3> axes{0, 1, 2};
  std::stable_sort(axes.begin(), axes.end(), [&](int a, int b) { return std::abs(d[a]) > std::abs(d[b]); });
  const auto letter = [&](int axis) { return d[axis] < 0 ? kNegative[axis] : kPositive[axis]; };
  std::string letters(1, letter(axes[0]));
  // tolerance, so that rounding does not add an axis at exactly 20 degrees
  if (std::abs(d[axes[0]]) < std::cos(oblique) - 1e-9) {
    letters += letter(axes[1]);
    if (std::abs(d[axes[2]]) > std::sin(oblique) + 1e-9) letters += letter(axes[2]);
  }
  return letters;
}

/// Smallest rotation from one unit vector to another; for opposite ones half a turn about `spare`, which is
/// orthogonal to them.
Rotation<Patient, Patient> min_turn(const Vector<Patient>& from, const Vector<Patient>& to,
                                    const Vector<Patient>& spare) {
  constexpr double kPi = 3.14159265358979323846;
  // unnormalised quaternion: cosine and sine of half the angle, up to a common factor
  const Eigen::Vector3d axis = from.cross(to).eigen();
  const double cosine = from.dot(to);
  if (cosine < 0 && axis.squaredNorm() < 1e-20) return Rotation<Patient, Patient>::about(spare.eigen(), kPi);
  return Rotation<Patient, Patient>(Eigen::Quaterniond(1 + cosine, axis.x(), axis.y(), axis.z()));
}

}  // namespace

Point<Patient> rest_position(const Point<Patient>& displayed, const TissueDisplacement& moved) {
  constexpr int kWholeSteps = 6;
  Point<Patient> at = displayed;
  for (int step = 0; step < kMaxAtRestSteps; ++step) {
    const Vector<Patient> off = (displayed - at) - moved(at);
    at += off * (step < kWholeSteps ? 1.0 : 0.5);
    if (!(off.norm() > kAtRestNear_mm)) break;
  }
  return at;
}

std::size_t SectionPlane::pixel_count() const {
  PALPATE_CHECK(width_px > 0 && height_px > 0);
  return static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px);
}

Point<Patient> SectionPlane::at(double column, double row) const {
  const double x_mm = (column - 0.5 * (width_px - 1)) * mm_per_px();
  const double y_mm = (row - 0.5 * (height_px - 1)) * mm_per_px();
  return centre + right * x_mm + down * y_mm;
}

std::array<double, 2> SectionPlane::pixel_of(const Point<Patient>& p) const {
  const Vector<Patient> offset = p - centre;
  return {offset.dot(right) / mm_per_px() + 0.5 * (width_px - 1),
          offset.dot(down) / mm_per_px() + 0.5 * (height_px - 1)};
}

SectionPlane anatomical_section(AnatomicalPlane plane, const Point<Patient>& centre, double width_mm,
                                int width_px, int height_px) {
  const Vector<Patient> left(1, 0, 0), posterior(0, 1, 0), inferior(0, 0, -1);
  SectionPlane section;
  section.centre = centre;
  section.right = plane == AnatomicalPlane::kSagittal ? posterior : left;
  section.down = plane == AnatomicalPlane::kAxial ? posterior : inferior;
  section.width_mm = width_mm;
  section.width_px = width_px;
  section.height_px = height_px;
  return section;
}

SectionPlane oblique_section(const Point<Patient>& centre, const Vector<Patient>& direction, ObliqueView view,
                             double width_mm, int width_px, int height_px, const SectionPlane* before) {
  SectionPlane section = anatomical_section(AnatomicalPlane::kCoronal, centre, width_mm, width_px, height_px);
  if (before != nullptr) {
    section.right = before->right;
    section.down = before->down;
  }
  // scaled first, because the square of a tiny or huge component under- or overflows
  const double largest = direction.eigen().cwiseAbs().maxCoeff();
  if (!direction.all_finite() || !(largest > 0)) return section;
  const Vector<Patient> to = (direction / largest).normalized();

  const Vector<Patient> from = view == ObliqueView::kAlong ? section.down : section.right.cross(section.down);
  const Vector<Patient> right = min_turn(from, to, section.right) * section.right;
  // reorthogonalised, so that rounding errors do not accumulate over a sequence of sections
  section.right = (right - to * to.dot(right)).normalized();
  section.down = view == ObliqueView::kAlong ? to : to.cross(section.right);
  return section;
}

OrientationLetters orientation_letters(const SectionPlane& plane) {
  return {direction_letters(-plane.right), direction_letters(plane.right), direction_letters(-plane.down),
          direction_letters(plane.down)};
}

}  // namespace palpate
