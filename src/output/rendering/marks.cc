#include "rendering/marks.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

namespace palpate::marks {
namespace {

// bounding box of the volume's voxels along the patient's axes
std::string reach_text(const GridGeometry& grid) {
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  Eigen::Vector3d low = grid.centre().eigen(), high = low;
  for (int corner = 0; corner < 8; ++corner) {
    const auto end = [&](int axis) { return (corner >> axis & 1) != 0 ? grid.dims[axis] - 0.5 : -0.5; };
    const Eigen::Vector3d p = (X_PatientVoxel * Point<Voxel>(end(0), end(1), end(2))).eigen();
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return point_text(Point<Patient>(low)) + " to " + point_text(Point<Patient>(high));
}

}  // namespace

bool contains(const GridGeometry& grid, const Point<Patient>& p) {
  const Point<Voxel> voxel = grid.X_PatientVoxel().inverse() * p;
  for (int axis = 0; axis < 3; ++axis)
    if (!(voxel[axis] >= -0.5 && voxel[axis] <= grid.dims[axis] - 0.5)) return false;
  return true;
}

std::string point_text(const Point<Patient>& p) {
  char text[120];
  std::snprintf(text, sizeof text, "%.1f, %.1f, %.1f", p.x(), p.y(), p.z());
  return text;
}

Error outside_error(const GridGeometry& grid, const Point<Patient>& p) {
  return {ErrorKind::kBadInput, "the point " + point_text(p) + " mm lies outside the volume", "centre",
          "the volume reaches from " + reach_text(grid) + " mm (LPS)"};
}

double scale_bar_mm(double width_mm) {
  const double largest = 0.25 * width_mm, power = std::pow(10, std::floor(std::log10(largest)));
  for (const double factor : {5.0, 2.0})
    if (factor * power <= largest) return factor * power;
  return power;
}

std::string short_name(const Model& model, LabelId label, std::size_t longest) {
  const std::string name = model.name_of(label);
  const bool plain = std::all_of(name.begin(), name.end(), [](char c) { return c >= 0x20 && c < 0x7f; });
  return plain && name.size() <= longest ? name : "label " + std::to_string(label);
}

std::vector<LabelId> largest_first(const std::vector<LabelId>& labels) {
  std::map<LabelId, std::size_t> area;
  for (const LabelId label : labels)
    if (label != 0) ++area[label];
  std::vector<std::pair<std::size_t, LabelId>> order;
  for (const auto& [label, pixels] : area) order.emplace_back(pixels, label);
  std::sort(order.rbegin(), order.rend());
  std::vector<LabelId> result;
  for (const auto& [pixels, label] : order) result.push_back(label);
  return result;
}

}  // namespace palpate::marks
