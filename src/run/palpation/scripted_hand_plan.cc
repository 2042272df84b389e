#include <algorithm>
#include <map>
#include <numbers>
#include <random>
#include <utility>

#include "palpate/model/changed_model.h"
#include "palpation/scripted_hand_parts.h"

namespace palpate {
using namespace scripted_hand;

namespace {

constexpr std::size_t kMaxTries = 4;
constexpr double kStepBack_mm = 5;

// structure by name, or by label as "#95"
Result<LabelId> find_structure(const Model& model, const std::string& name, const std::string& where) {
  const auto is_named = [&](const Segment& segment) {
    return segment.name == name && model.is_touchable(segment.id);
  };
  const auto count = std::count_if(model.segments.begin(), model.segments.end(), is_named);
  if (count > 1) {
    std::string ids;
    for (const Segment& segment : model.segments)
      if (is_named(segment)) ids += (ids.empty() ? "\"#" : ", \"#") + std::to_string(segment.id) + "\"";
    return Error{ErrorKind::kBadInput,
                 std::to_string(count) + " structures of this scene are named '" + name + "'", where,
                 "choose one by its number: " + ids};
  }
  const auto one = std::find_if(model.segments.begin(), model.segments.end(), is_named);
  const Segment* segment = one != model.segments.end() ? &*one : model.find(name);
  if (!segment && name.size() > 1 && name[0] == '#' &&
      name.find_first_not_of("0123456789", 1) == std::string::npos && name.size() < 7)
    segment = model.find(static_cast<LabelId>(std::stoi(name.substr(1))));
  if (segment) return segment->id;
  std::string known;
  for (const Segment& s : model.segments)
    if (model.is_touchable(s.id))
      known += (known.empty() ? "" : ", ") + (s.name.empty() ? "#" + std::to_string(s.id) : s.name);
  return Error{ErrorKind::kBadInput, "no structure '" + name + "' in this scene", where,
               "touchable structures are: " + known};
}

// a subsample of the voxel centres on a structure's border
std::vector<Point<Patient>> some_of_border(const Model& model, LabelId structure) {
  constexpr std::size_t kMaxPoints = 2000;
  const auto X_PatientVoxel = model.labels->geometry().X_PatientVoxel();
  std::vector<Point<Patient>> border;
  model.labels->for_each_piece([&](const RowPiece<LabelId>& piece) {
    if (piece.uniform) return;
    for (int n = 0; n < piece.count; ++n) {
      const LabelId* const voxel = piece.voxels + n;
      if (*voxel != structure) continue;
      const auto& faces = BrickLayout::kFaces;
      if (std::any_of(faces.begin(), faces.end(), [&](auto face) { return voxel[face] != structure; }))
        border.push_back(X_PatientVoxel * Point<Voxel>(piece.i + n, piece.j, piece.k));
    }
  });
  const std::size_t stride = border.size() / kMaxPoints + 1;
  std::vector<Point<Patient>> some;
  for (std::size_t b = 0; b < border.size(); b += stride) some.push_back(border[b]);
  return some;
}

// After a cut the surfaces of tissue can no longer be changed, and a script cannot know when the first cut
// happens.
Result<void> check_law(const Model& model, TissueLaw law, const std::string& where) {
  if (model.has_burr() && has_other_surfaces(model, law))
    return Error{ErrorKind::kBadInput,
                 "soft tissue cannot change between yielding and not yielding in a scene with a cutting tool",
                 where, "set the law in the scene's [yielding], so that it applies from the start"};
  if (model.has_burr() && is_moving(law) && !is_moving(model.tissue_law))
    return Error{ErrorKind::kBadInput, "soft tissue cannot start to move in a scene with a cutting tool",
                 where, "set the law in the scene's [yielding], so that it moves from the start"};
  const auto fine = palpate::check_law(model, law);
  if (fine) return {};
  Error error = fine.error();
  error.where = where;
  return error;
}

}  // namespace

Result<ScriptedHand> ScriptedHand::create(const Model& model, const Script& script) {
  if (model.field == nullptr)
    return Error{ErrorKind::kBadInput, "the model has no field for a simulated hand to plan its places in",
                 "model", "prepare it for a direct method as well"};
  const auto device = find_plant_device(script.device);
  if (!device) return device.error();
  const auto grip = find_plant_hand(script.hand);
  if (!grip) return grip.error();
  ScriptedHand hand(model, script, *device, *grip);
  LabelId structure = 0;
  for (std::size_t s = 0; s < script.steps.size(); ++s) {
    auto step = hand.planned(script.steps[s], script.lines[s], structure,
                             script.source + ":" + std::to_string(script.lines[s]));
    if (!step) return step.error();
    structure = step->structure;
    hand.steps_.push_back(*std::move(step));
  }
  return hand;
}

/// @param before  structure of the preceding approach
Result<ScriptedHand::PlannedStep> ScriptedHand::planned(const ScriptStep& action, int line, LabelId before,
                                                        const std::string& where) {
  PlannedStep step{action, line, before, {}};
  if (const auto* change = std::get_if<LawStep>(&action))
    if (auto fine = check_law(*model_, change->law, where); !fine) return fine.error();
  const auto* approach = std::get_if<ApproachStep>(&action);
  if (!approach) return step;

  TouchRequest request;
  request.clearance_mm = approach->clearance_mm;
  request.landmark = approach->landmark;
  request.from = approach->from;
  if (approach->point) {
    step.structure = contact_structure_near(*model_, *approach->point);
    if (step.structure == 0)
      return Error{ErrorKind::kBadInput,
                   "no touchable structure within 5 mm of the point " + position_text(*approach->point),
                   where, "give a point on a surface, in patient coordinates (mm, LPS), or name a structure"};
    request.near = {*approach->point};
  } else {
    const auto label = find_structure(*model_, approach->structure, where);
    if (!label) return label.error();
    step.structure = *label;
  }
  if (!model_->is_touchable(step.structure))
    return Error{ErrorKind::kBadInput,
                 "'" + model_->name_of(step.structure) + "' is not touchable in this scene", where,
                 "set touchable = true on its [[tissue]], or choose another structure"};
  if (const auto* other = std::get_if<std::string>(&approach->nearest)) {
    const auto label = find_structure(*model_, *other, where);
    if (!label) return label.error();
    request.near = some_of_border(*model_, *label);
  }
  if (const auto* site = std::get_if<Point<Patient>>(&approach->nearest)) request.near = {*site};
  step.sites = find_touch_sites(*model_, free_space_, step.structure, request);
  if (step.sites.sites.size() > kMaxTries) step.sites.sites.resize(kMaxTries);
  return step;
}

ScriptedHand::ScriptedHand(const Model& model, const Script& script, const PlantDevice& device,
                           const PlantHand& hand)
    : model_(&model),
      device_(device),
      hand_(hand),
      law_(model.tissue_law),
      free_space_(model, tool_reach_mm(model.tool_of(0))),
      tool_reach_mm_(tool_reach_mm(model.tool_of(0))) {
  // in the air, a hand's breadth in front of the patient
  const GridGeometry& grid = model.labels->geometry();
  double max_anterior_mm = grid.centre().y();
  for (int corner = 0; corner < 8; ++corner) {
    Point<Voxel> p;
    for (int axis = 0; axis < 3; ++axis) p[axis] = corner >> axis & 1 ? grid.dims[axis] - 0.5 : -0.5;
    const Point<Patient> at = grid.X_PatientVoxel() * p;
    max_anterior_mm = std::min(max_anterior_mm, at.y());
    clear_of_object_mm_ = std::max(clear_of_object_mm_, (model.X_WorldPatient * at - Point<World>()).norm());
  }
  clear_of_object_mm_ += tool_reach_mm_ + kStepBack_mm;
  constexpr double kBefore_mm = 3;
  start_ =
      model.X_WorldPatient *
      Point<Patient>(grid.centre().x(), max_anterior_mm - kBefore_mm - tool_reach_mm_, grid.centre().z());
  commanded_ = start_;

  std::mt19937_64 random(script.seed);
  const auto uniform = [&] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  for (auto& axis : tremor_)
    for (Wave& wave : axis)
      wave = {script.tremor_mm / 3, 2 * std::numbers::pi * (8 + 4 * uniform()),
              2 * std::numbers::pi * uniform()};
}

std::vector<HoldRequest> ScriptedHand::requested() const {
  std::vector<HoldRequest> holds;
  const auto request_for = [&](LabelId structure) -> HoldRequest& {
    const auto found = std::find_if(holds.begin(), holds.end(),
                                    [&](const HoldRequest& a) { return a.structure == structure; });
    return found != holds.end() ? *found : holds.emplace_back(HoldRequest{structure, {}});
  };
  for (const PlannedStep& step : steps_) {
    if (std::holds_alternative<ApproachStep>(step.action)) request_for(step.structure);
    if (const auto* press = std::get_if<PressStep>(&step.action))
      request_for(step.structure).forces_N.push_back(press->force_N);
  }
  return holds;
}

Vector<World> ScriptedHand::tremor() const {
  Vector<World> sum;
  for (int axis = 0; axis < 3; ++axis)
    for (const Wave& wave : tremor_[axis])
      sum[axis] += wave.amplitude_mm * std::sin(wave.omega * time_s_ + wave.phase);
  return sum;
}

}  // namespace palpate
