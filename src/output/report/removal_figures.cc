#include "report/removal_figures.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace palpate::report {
namespace {

constexpr double kAlongAxis_mm = 0.1;
constexpr int kExitDirections = 256;

// directions distributed evenly on the sphere: a golden-angle spiral from pole to pole
std::vector<Vector<Patient>> ray_directions() {
  std::vector<Vector<Patient>> directions;
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  for (int n = 0; n < kExitDirections; ++n) {
    const double z = 1 - (2 * n + 1.0) / kExitDirections, around = std::sqrt(1 - z * z);
    directions.emplace_back(around * std::cos(n * golden), around * std::sin(n * golden), z);
  }
  return directions;
}

/// Surface from which a structure's depth is measured.
/// @param inside  centre of one of its voxels, where all surfaces that enclose the structure are negative and
///                others are not
const Surface* surface_of(const Model& model, LabelId label, const Point<Patient>& inside) {
  const auto& labels = model.label_of_surface;
  const auto index = static_cast<std::size_t>(std::ranges::find(labels, label) - labels.begin());
  if (index >= labels.size() || index >= model.surfaces.size()) return nullptr;
  const ContactSurface& own = model.surfaces[index];
  if (own.surface != nullptr) return own.surface.get();
  const Surface* outermost = nullptr;
  double min_mm = std::numeric_limits<double>::infinity();
  for (const ContactSurface& surface : std::span(model.surfaces).subspan(labels.size())) {
    if (surface.surface == nullptr || surface.layer != own.layer) continue;
    const double distance_mm = surface.surface->distance_mm(inside);
    if (distance_mm >= min_mm) continue;
    min_mm = distance_mm;
    outermost = surface.surface.get();
  }
  return outermost;
}

double deepest_mm(const Surface& surface, const Sweep& sweep) {
  const Vector<Patient> displacement = sweep.to - sweep.from;
  const int steps = static_cast<int>(std::ceil(displacement.norm() / kAlongAxis_mm));
  const int row = static_cast<int>(std::ceil(sweep.axis_mm.norm() / kAlongAxis_mm));
  double depth_mm = -std::numeric_limits<double>::infinity();
  for (int ball = 0; ball <= row; ++ball) {
    const double part = row > 0 ? static_cast<double>(ball) / row : 0.0;
    const double radius_mm =
        row > 0 ? sweep.radius_mm + (sweep.end_radius_mm - sweep.radius_mm) * part : sweep.radius_mm;
    for (int n = 0; n <= steps; ++n) {
      const Point<Patient> at =
          sweep.from + displacement * (steps > 0 ? static_cast<double>(n) / steps : 0.0);
      depth_mm = std::max(depth_mm, radius_mm + depth_below_mm(surface, at + sweep.axis_mm * part));
    }
  }
  return depth_mm;
}

}  // namespace

double depth_below_mm(const Surface& surface, const Point<Patient>& x) {
  constexpr double kMinReach_mm = 0.5;
  // closer to the limit of the distance field, a cell may have corners beyond it
  const double reach_mm = surface.outside_mm() - surface.distance_field().geometry().spacing_mm.norm();
  const double depth_mm = -surface.distance_mm(x);
  if (depth_mm < reach_mm || reach_mm < kMinReach_mm) return depth_mm;
  // Where the distance is saturated, the surface is at least reach_mm away in every direction: each ray
  // advances by that (sphere tracing) until the remaining distance is within reach.
  static const std::vector<Vector<Patient>> directions = ray_directions();
  double shortest_mm = std::numeric_limits<double>::infinity();
  for (const Vector<Patient>& direction : directions)
    for (double advanced_mm = reach_mm; advanced_mm < shortest_mm; advanced_mm += reach_mm) {
      const double left_mm = -surface.distance_mm(x + direction * advanced_mm);
      if (left_mm < reach_mm) shortest_mm = std::min(shortest_mm, advanced_mm + std::max(0.0, left_mm));
    }
  return shortest_mm;
}

double RemovalFigures::volume_mm3() const {
  double sum_mm3 = 0;
  for (const StructureRemoval& structure : structures) sum_mm3 += structure.volume_mm3;
  return sum_mm3;
}

std::vector<double> RemovalFigures::removed_mm3(std::size_t structure,
                                                std::span<const double> times_s) const {
  std::vector<double> removed;
  double mm3 = 0;
  auto step = steps.begin();
  for (const double time_s : times_s) {
    for (; step != steps.end() && step->time_s <= time_s; ++step)
      if (structure < step->volumes_mm3.size()) mm3 = step->volumes_mm3[structure];
    removed.push_back(mm3);
  }
  return removed;
}

RemovalMeter::RemovalMeter(const Model& model) : model_(model), removed_(model), nearest_(model) {}

void RemovalMeter::on_event(std::span<const RecordingEvent> events) {
  if (model_.labels == nullptr) return;
  for (const RecordingEvent& event : events)
    if (event.kind == RecordingEvent::Kind::kSweep ||
        (event.kind == RecordingEvent::Kind::kModel &&
         (event.change.tissue == ModelChange::kCut || event.change.is_of_stroke())))
      pending_events_.push_back(event);
}

void RemovalMeter::on_event(const RecordingEvent& event, double time_s) {
  if (event.kind == RecordingEvent::Kind::kSweep) {
    pending_cuts_.push_back(cut_of(event.sweep));
    return;
  }
  const auto before_mm3 = volumes_mm3_;
  if (event.change.is_of_stroke()) {
    change_stroke(event.change);
    const bool undone = event.change.tissue == ModelChange::kUndo;
    figures_.changes.push_back({time_s, {}, undone ? StrokeAction::kUndo : StrokeAction::kRedo});
  } else {
    remove_voxels(time_s);
  }
  if (volumes_mm3_ != before_mm3) add_step(time_s);
}

void RemovalMeter::observe(const TimedTick& now) {
  for (; !pending_events_.empty() && pending_events_.front().tick <= now.tick.tick;
       pending_events_.pop_front())
    on_event(pending_events_.front(), now.begin_s);
  nearest_.observe(now.tick);
  if (motor_was_on(model_, now.tick)) figures_.motor_s += now.end_s - now.begin_s;
}

void RemovalMeter::remove_voxels(double time_s) {
  for (const Cut& cut : pending_cuts_) remove_voxels(cut, time_s);
  figures_.changes.push_back({time_s, std::exchange(pending_cuts_, {}), std::nullopt});
}

void RemovalMeter::add_step(double time_s) {
  RemovalStep& step = figures_.steps.emplace_back();
  step.time_s = time_s;
  for (const StructureRemoval& structure : figures_.structures)
    step.volumes_mm3.push_back(structure.volume_mm3);
}

void RemovalMeter::change_stroke(const ModelChange& change) {
  if (change.tissue == ModelChange::kUndo) {
    strokes_.undo();
    removed_.undo();
  } else {
    strokes_.redo();
    removed_.redo();
  }
  const std::map<LabelId, double> removed_mm3 = removed_.by_label_mm3();
  for (StructureRemoval& structure : figures_.structures) {
    const auto removed = removed_mm3.find(structure.label);
    structure.volume_mm3 = removed != removed_mm3.end() ? removed->second : 0;
    structure.fraction = structure.volume_mm3 / all_mm3(structure.label);
    volumes_mm3_[structure.label] = structure.volume_mm3;
  }
}

RemovalFigures RemovalMeter::finish() {
  figures_.undone = figures_.strokes - strokes_.done().size();
  for (const ProtectedStructure& structure : model_.protected_structures) {
    const auto nearest = nearest_.nearest_mm().find(structure.label);
    figures_.spared.push_back({structure.label, structure.is_protected,
                               nearest != nearest_.nearest_mm().end() ? nearest->second : kGap});
  }
  return std::move(figures_);
}

double RemovalMeter::all_mm3(LabelId label) const {
  return static_cast<double>(structure_[label].voxels) * model_.labels->geometry().spacing_mm.prod();
}

void RemovalMeter::remove_voxels(const Cut& cut, double time_s) {
  if (!strokes_.continues(cut.sweep.stroke))
    strokes_.begin(cut.sweep.stroke, ++figures_.strokes, std::numeric_limits<std::size_t>::max());
  removed_.add({&cut, 1});
  if (cut.device != Cut::kBrokenOff) nearest_.observe(cut.sweep);
  for (const auto& [label, mm3] : removed_.by_label_mm3()) {
    if (mm3 == volumes_mm3_[label]) continue;
    volumes_mm3_[label] = mm3;
    auto& structures = figures_.structures;
    auto found = std::ranges::find(structures, label, &StructureRemoval::label);
    if (found == structures.end()) {
      if (structure_.empty()) count_voxels();
      const auto& [i, j, k] = structure_[label].first;
      const Point<Patient> inside = model_.labels->geometry().X_PatientVoxel() * Point<Voxel>(i, j, k);
      surface_.push_back(surface_of(model_, label, inside));
      found = structures.insert(structures.end(), {.label = label, .first_s = time_s});
    }
    found->volume_mm3 = mm3;
    found->fraction = mm3 / all_mm3(label);
    found->last_s = time_s;
    const Surface* surface = surface_[static_cast<std::size_t>(found - structures.begin())];
    if (surface != nullptr) found->depth_mm = std::fmax(found->depth_mm, deepest_mm(*surface, cut.sweep));
  }
}

void RemovalMeter::count_voxels() {
  structure_.resize(std::size_t{std::numeric_limits<LabelId>::max()} + 1);
  model_.labels->for_each_piece([&](const RowPiece<LabelId>& piece) {
    for (int n = 0; n < piece.count; ++n) {
      Structure& structure = structure_[piece.voxels[n]];
      if (structure.voxels++ == 0) structure.first = {piece.i + n, piece.j, piece.k};
    }
  });
}

std::shared_ptr<const Model> model_after_removal(const Model& model, std::span<const RemovalChange> changes,
                                                 double time_s) {
  // surfaces take longer to update and are not displayed
  auto carved = std::make_shared<Model>(model);
  carved->surfaces.clear();
  carved->label_of_surface.clear();
  const auto nothing = std::make_shared<const Carving>(*carved);
  std::shared_ptr<const Carving> carving = nothing;
  for (const RemovalChange& change : changes) {
    if (change.time_s > time_s) break;
    if (!change.stroke) {
      carving = carving->with(change.cuts);
    } else if (const auto other =
                   *change.stroke == StrokeAction::kUndo ? carving->undone() : carving->redone()) {
      carving = other;
    }
  }
  return carving != nothing ? carving->applied_to(*carved) : nullptr;
}

}  // namespace palpate::report
