#include "palpate/tissue/chain_mail.h"

#include <algorithm>
#include <cmath>

#include "palpate/contact/soft_contact.h"
#include "palpate/tissue/carved_cells.h"
#include "palpate/tissue/soft_tissue_solver.h"
#include "tissue/each_cell.h"
#include "tissue/solver_box.h"

namespace palpate {
namespace {

// relaxation passes per frame, which spread a dent or restore the rest state
constexpr int kPasses = 4;
// displacement below which a mail counts as at rest
constexpr double kAtRest_mm = 1e-3;

struct Step {
  int axis, sign;
};
constexpr Step kNeighbours[] = {{0, 1}, {0, -1}, {1, 1}, {1, -1}, {2, 1}, {2, -1}};

std::array<int, 3> beside(int i, int j, int k, int neighbour) {
  std::array<int, 3> at{i, j, k};
  at[static_cast<std::size_t>(kNeighbours[neighbour].axis)] += kNeighbours[neighbour].sign;
  return at;
}

}  // namespace

bool find_dent(const Model& model, const TickRecord& record, std::size_t device, Dent& dent) {
  if (device >= static_cast<std::size_t>(std::clamp(record.devices, 0, kMaxDevices))) return false;
  const DeviceTick& device_tick = record.device[device];
  const Tissue* const tissue = model.tissue_of(device_tick.contact_label[0]);
  if (device_tick.contact_label[0] == 0 || tissue == nullptr || !model.moves_visibly(*tissue)) return false;
  dent.at = Point<Patient>(device_tick.contact_patient_mm[0], device_tick.contact_patient_mm[1],
                           device_tick.contact_patient_mm[2]);
  dent.outward = Vector<Patient>(device_tick.normal_patient[0], device_tick.normal_patient[1],
                                 device_tick.normal_patient[2])
                     .normalized();
  dent.depth_mm = device_tick.depth_mm;
  dent.radius_mm = std::max(model.tool_of(device).radius_mm, kSoftTissueSettings.min_radius_mm);
  return dent.at.all_finite() && dent.outward.all_finite() && dent.outward.norm() > 0.5;
}

/// Bounds that one neighbour imposes on a node's displacement, by axis.
struct ChainMail::Bounds {
  std::array<float, 3> low, high;
};

ChainMail::ChainMail(const ElasticGrid& grid)
    : box_(grid.box()), layout_(grid.layout()), displacement_mm_(grid.layout()) {
  state_.resize(number(0, 0, layout_.cells[2] + 1), kFree);
  visited_.resize(state_.size());
  const auto& cells = layout_.cells;
  for_each_node({{0, 0, 0}, cells}, [&](int i, int j, int k) {
    const bool face = i == 0 || j == 0 || k == 0 || i == cells[0] || j == cells[1] || k == cells[2];
    const std::uint8_t constraints = grid.constraint(i, j, k);
    state_[number(i, j, k)] = (constraints & ElasticGrid::kNoNode) != 0          ? kNone
                              : face || (constraints & ElasticGrid::kFixed) != 0 ? kFixed
                                                                                 : kFree;
  });
}

std::size_t ChainMail::number(int i, int j, int k) const {
  return (static_cast<std::size_t>(k) * (layout_.cells[1] + 1) + j) * (layout_.cells[0] + 1) + i;
}

ChainMail::Bounds ChainMail::bounds_of(int i, int j, int k, int neighbour) const {
  const auto [axis, sign] = kNeighbours[neighbour];
  const auto at = beside(i, j, k, neighbour);
  const auto edge_mm = static_cast<float>(box_.cell_mm);
  const float shorter = (1 - static_cast<float>(kMinStretch)) * edge_mm,
              longer = (static_cast<float>(kMaxStretch) - 1) * edge_mm,
              lateral = static_cast<float>(kShear) * edge_mm;
  Bounds bounds;
  for (int c = 0; c < 3; ++c) {
    const float neighbour_mm = displacement_mm_.values[layout_.node(at[0], at[1], at[2], c)];
    const auto n = static_cast<std::size_t>(c);
    // relative to a neighbour in the positive direction the node may approach by `shorter` and recede by
    // `longer`
    const float below = c != axis ? lateral : sign > 0 ? longer : shorter;
    const float above = c != axis ? lateral : sign > 0 ? shorter : longer;
    bounds.low[n] = neighbour_mm - below;
    bounds.high[n] = neighbour_mm + above;
  }
  return bounds;
}

void ChainMail::queue_neighbours(int i, int j, int k) {
  for (int neighbour = 0; neighbour < 6; ++neighbour) {
    const auto at = beside(i, j, k, neighbour);
    bool is_inside = true;
    for (std::size_t axis = 0; axis < 3; ++axis)
      is_inside = is_inside && at[axis] >= 0 && at[axis] <= layout_.cells[axis];
    if (!is_inside) continue;
    // the pulling neighbour as seen from there is in the opposite direction
    queue_.push_back({static_cast<std::int16_t>(at[0]), static_cast<std::int16_t>(at[1]),
                      static_cast<std::int16_t>(at[2]), static_cast<std::int16_t>(neighbour ^ 1)});
  }
}

// processes the queued links, first in, first out
void ChainMail::pull() {
  ++move_;
  for (std::size_t n = 0; n < queue_.size(); ++n) {
    const Link link = queue_[n];
    const std::size_t node = number(link.i, link.j, link.k);
    if (state_[node] != kFree || visited_[node] == move_) continue;
    const Bounds bounds = bounds_of(link.i, link.j, link.k, link.by);
    bool is_moving = false;
    for (int c = 0; c < 3; ++c) {
      float& moved = displacement_mm_.values[layout_.node(link.i, link.j, link.k, c)];
      const float bound = std::clamp(moved, bounds.low[static_cast<std::size_t>(c)],
                                     bounds.high[static_cast<std::size_t>(c)]);
      is_moving = is_moving || bound != moved;
      moved = bound;
    }
    if (!is_moving) continue;
    visited_[node] = move_;
    queue_neighbours(link.i, link.j, link.k);
  }
  queue_.clear();
}

void ChainMail::release() {
  for (State& state : state_)
    if (state == kByTool) state = kFree;
}

void ChainMail::press(const Dent& dent) {
  release();
  // a tool thinner than a cell still moves the surrounding nodes
  const double radius_mm = std::max(dent.radius_mm, box_.cell_mm);
  const Eigen::Vector3d centre = box_.local_mm(dent.at);
  const Eigen::Vector3d outward = box_.axes.transpose() * dent.outward.eigen();
  struct Moved {
    double to_mm;  // outward displacement that the tool imposes
    int i, j, k;
  };
  std::vector<Moved> moved;
  for_each_node({{0, 0, 0}, layout_.cells}, [&](int i, int j, int k) {
    if (state_[number(i, j, k)] != kFree) return;
    const Eigen::Vector3d from = Eigen::Vector3d(i, j, k) * box_.cell_mm - centre;
    const double above_mm = from.dot(outward);
    const double lateral_squared = (from - outward * above_mm).squaredNorm();
    // the column's node at the surface, and nodes of partly filled cells above it
    if (above_mm < -0.5 * box_.cell_mm || above_mm > box_.cell_mm || lateral_squared >= radius_mm * radius_mm)
      return;
    const double to_mm = radius_mm - std::sqrt(radius_mm * radius_mm - lateral_squared) - dent.depth_mm;
    if (to_mm < 0) moved.push_back({to_mm, i, j, k});
  });
  std::stable_sort(moved.begin(), moved.end(),
                   [](const Moved& a, const Moved& b) { return a.to_mm < b.to_mm; });
  for (const auto& [to_mm, i, j, k] : moved) {
    Eigen::Vector3d now;
    for (int c = 0; c < 3; ++c) now[c] = displacement_mm_.values[layout_.node(i, j, k, c)];
    const double further_mm = to_mm - now.dot(outward);
    if (further_mm >= 0) continue;
    now += outward * further_mm;
    for (int c = 0; c < 3; ++c)
      displacement_mm_.values[layout_.node(i, j, k, c)] = static_cast<float>(now[c]);
    state_[number(i, j, k)] = kByTool;
    queue_neighbours(i, j, k);
    pull();
  }
  // fixed nodes pull back as far as the bounds allow
  for_each_node({{0, 0, 0}, layout_.cells}, [&](int i, int j, int k) {
    if (state_[number(i, j, k)] == kFixed) queue_neighbours(i, j, k);
  });
  pull();
}

void ChainMail::relax(int passes) {
  constexpr float kWide_mm = 1e6f;
  for (int pass = 0; pass < passes; ++pass)
    for_each_node({{0, 0, 0}, layout_.cells}, [&](int i, int j, int k) {
      if (state_[number(i, j, k)] != kFree) return;
      std::array<float, 3> sum{}, low{-kWide_mm, -kWide_mm, -kWide_mm}, high{kWide_mm, kWide_mm, kWide_mm};
      float count = 0;
      for (int neighbour = 0; neighbour < 6; ++neighbour) {
        // nodes on faces are fixed, so every other node has six neighbours
        const auto at = beside(i, j, k, neighbour);
        if (state_[number(at[0], at[1], at[2])] == kNone) continue;
        const Bounds bounds = bounds_of(i, j, k, neighbour);
        for (std::size_t c = 0; c < 3; ++c) {
          sum[c] += displacement_mm_.values[layout_.node(at[0], at[1], at[2], static_cast<int>(c))];
          low[c] = std::max(low[c], bounds.low[c]);
          high[c] = std::min(high[c], bounds.high[c]);
        }
        count += 1;
      }
      for (std::size_t c = 0; c < 3; ++c)
        // contradictory bounds: no movement
        if (count > 0 && low[c] <= high[c])
          displacement_mm_.values[layout_.node(i, j, k, static_cast<int>(c))] =
              std::clamp(sum[c] / count, low[c], high[c]);
    });
}

void ChainMail::copy_overlap(const ChainMail& other, const std::array<int, 3>& offset) {
  for_each_node({{0, 0, 0}, layout_.cells}, [&](int i, int j, int k) {
    const std::array<int, 3> there{i + offset[0], j + offset[1], k + offset[2]};
    for (std::size_t axis = 0; axis < 3; ++axis)
      if (there[axis] < 0 || there[axis] > other.layout_.cells[axis]) return;
    if (state_[number(i, j, k)] != kFree) return;
    for (int c = 0; c < 3; ++c)
      displacement_mm_.values[layout_.node(i, j, k, c)] =
          other.displacement_mm_.values[other.layout_.node(there[0], there[1], there[2], c)];
  });
}

double ChainMail::max_displacement_mm() const {
  double largest = 0;
  for (const float moved : displacement_mm_.values)
    largest = std::max(largest, std::abs(static_cast<double>(moved)));
  return largest;
}

struct ChainMailTissue::Region {
  SolverBox where;
  CarvedLabels labels;
  std::vector<ElasticMaterial> by_label;
  ChainMail mail;
};

ChainMailTissue::ChainMailTissue() = default;
ChainMailTissue::~ChainMailTissue() = default;

void ChainMailTissue::advance(const Model& model, const TickRecord& record) {
  std::vector<ElasticMaterial> by_label = materials_of(model);
  const CarvedLabels labels = carved_labels(model);
  for (std::size_t d = 0; d < kMaxDevices; ++d) {
    std::unique_ptr<Region>& region = regions_[d];
    Dent dent;
    const bool pressed = find_dent(model, record, d, dent);
    const bool same = region != nullptr && region->labels.original == labels.original &&
                      region->labels.removed_fraction == labels.removed_fraction &&
                      region->by_label == by_label;
    if (pressed) {
      const Eigen::Vector3d centre = solver_box_centre(model, dent.at, dent.outward);
      if (!same || !box_covers(model, region->where.first_cell, centre)) {
        const SolverBox where{first_cell_around(model, centre), dent.at};
        auto next = std::make_unique<Region>(
            Region{where, labels, by_label, ChainMail(solver_box_cells(model, by_label, where).grid())});
        if (region != nullptr && region->by_label == by_label) {
          std::array<int, 3> offset;
          for (std::size_t axis = 0; axis < 3; ++axis)
            offset[axis] = where.first_cell[axis] - region->where.first_cell[axis];
          next->mail.copy_overlap(region->mail, offset);
        }
        region = std::move(next);
      }
      region->mail.press(dent);
    } else if (region != nullptr) {
      region->mail.release();
    }
    if (region == nullptr) continue;
    region->mail.relax(kPasses);
    if (!pressed && region->mail.max_displacement_mm() < kAtRest_mm) region.reset();
  }
}

const ChainMail* ChainMailTissue::of(std::size_t device) const {
  return device < regions_.size() && regions_[device] != nullptr ? &regions_[device]->mail : nullptr;
}

}  // namespace palpate
