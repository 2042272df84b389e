#include "link/veil.h"

#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <numeric>

#include "palpate/base/hash.h"

namespace palpate::link {
namespace {

constexpr std::size_t kLabels = std::size_t{std::numeric_limits<LabelId>::max()} + 1;

/// Of each hidden label the one that is not hidden and touches any of the hidden at most faces of voxels.
LabelId around(const Bricks<LabelId>& labels, const std::vector<bool>& hidden) {
  std::map<LabelId, std::size_t> faces;
  labels.for_each_piece([&](const RowPiece<LabelId>& piece) {
    if (piece.uniform) return;
    for (int n = 0; n < piece.count; ++n) {
      if (!hidden[piece.voxels[n]]) continue;
      for (const std::ptrdiff_t face : BrickLayout::kFaces)
        if (const LabelId other = piece.voxels[n + face]; !hidden[other]) ++faces[other];
    }
  });
  const auto most = std::ranges::max_element(faces, {}, [](const auto& entry) { return entry.second; });
  return most == faces.end() ? LabelId{0} : most->first;
}

template <class Labels>
void show_as(const Veil& veil, Labels& labels) {
  for (auto& label : labels) label = veil.shown(label);
}

/// Takes the entries of hidden labels out of parallel lists that end with label 0.
template <std::size_t kMost, class IsHidden, class Move, class Clear>
void take_out(std::array<std::uint16_t, kMost>& labels, const IsHidden& is_hidden, const Move& move,
              const Clear& clear) {
  std::size_t left = 0;
  for (std::size_t n = 0; n < kMost; ++n) {
    if (labels[n] == 0 || is_hidden(n)) continue;
    labels[left] = labels[n];
    if (left != n) move(n, left);
    ++left;
  }
  for (std::size_t n = left; n < kMost; ++n) {
    labels[n] = 0;
    clear(n);
  }
}

}  // namespace

bool has_quiz(const ViewedScene& scene) {
  return std::ranges::any_of(scene.tasks, &ViewedTask::quiz);
}

Veil::Veil(const ViewedScene& scene) : shown_(kLabels), scene_(scene) {
  std::iota(shown_.begin(), shown_.end(), LabelId{0});
  std::vector<bool> hidden(kLabels);
  for (const ViewedTask& task : scene.tasks)
    for (const LabelId label : task.quiz ? task.to_find : std::vector<LabelId>()) hidden[label] = true;
  if (std::ranges::find(hidden, true) != hidden.end()) {
    const LabelId as = around(*scene.labels, hidden);
    for (std::size_t label = 0; label < kLabels; ++label)
      if (hidden[label]) shown_[label] = as;
    scene_.labels =
        std::make_shared<const Bricks<LabelId>>(Bricks<LabelId>::of_labels(*scene.labels, shown_));
  }
  hide_in_tasks();
  take_names();
  // other voxels and names than those that somebody else may have kept
  std::uint64_t hash = scene.content_hash;
  hash_word(hash, scene_.labels->content_hash());
  scene_.content_hash = hash_finish(hash);
}

void Veil::hide_in_tasks() {
  for (ViewedTask& task : scene_.tasks) {
    if (task.quiz) task.to_find.clear();
    for (ViewedTask::Force& force : task.forces) show_as(*this, force.labels);
    for (ViewedTask::Protected& part : task.protections) show_as(*this, part.labels);
    for (ViewedTask::Metric& metric : task.metrics) show_as(*this, metric.labels);
  }
}

void Veil::take_names() {
  const std::vector<ViewedStructure> structures = scene_.structures;
  const auto structure_of = [&](LabelId label) {
    return std::ranges::find(structures, label, &ViewedStructure::label);
  };
  tissue_as_.resize(scene_.tissues.size());
  std::iota(tissue_as_.begin(), tissue_as_.end(), 0);
  for (std::size_t n = 0; n < scene_.structures.size(); ++n) {
    ViewedStructure& structure = scene_.structures[n];
    structure.name = "structure " + std::to_string(n + 1);
    if (!is_hidden(structure.label)) continue;
    const auto as = structure_of(shown(structure.label));
    if (as == structures.end()) continue;
    if (structure.tissue >= 0 && as->tissue >= 0)
      tissue_as_[static_cast<std::size_t>(structure.tissue)] = as->tissue;
    structure.colour = as->colour;
    structure.tissue = as->tissue;
  }
  const std::vector<ViewedTissue> tissues = scene_.tissues;
  for (std::size_t t = 0; t < tissues.size(); ++t) {
    scene_.tissues[t] = tissues[static_cast<std::size_t>(tissue_as_[t])];
    scene_.tissues[t].name = "tissue " + std::to_string(t + 1);
  }
  for (std::size_t n = 0; n < scene_.no_go.size(); ++n) {
    ViewedNoGo& region = scene_.no_go[n];
    region.name = "region " + std::to_string(n + 1);
    if (auto* label = std::get_if<LabelId>(&region.place)) *label = shown(*label);
  }
  if (scene_.recording)
    for (ViewedRecording::Contact& contact : scene_.recording->contacts) contact.label = shown(contact.label);
}

TickRecord Veil::of(TickRecord tick) const {
  for (DeviceTick& device : tick.device) {
    device.label = shown(device.label);
    // what the force comes from, and how deep that lies, is what a quiz asks for
    device.felt_label = {};
    device.felt_depth_mm = device.felt_share = {};
    // what is leant on first is there to be seen; what lies beneath it is not
    const std::uint16_t first = device.contact_label[0];
    take_out(
        device.contact_label, [&](std::size_t n) { return n > 0 && is_hidden(device.contact_label[n]); },
        [&](std::size_t from, std::size_t to) {
          device.contact_part[to] = device.contact_part[from];
          device.contact_N[to] = device.contact_N[from];
          for (std::size_t axis = 0; axis < 3; ++axis)
            device.contact_patient_mm[3 * to + axis] = device.contact_patient_mm[3 * from + axis];
        },
        [&](std::size_t n) {
          device.contact_part[n] = 0;
          device.contact_N[n] = 0;
          for (std::size_t axis = 0; axis < 3; ++axis) device.contact_patient_mm[3 * n + axis] = 0;
        });
    if (first != 0) device.contact_label[0] = shown(first);
    take_out(
        device.near_label, [&](std::size_t n) { return is_hidden(device.near_label[n]); },
        [&](std::size_t from, std::size_t to) { device.near_mm[to] = device.near_mm[from]; },
        [&](std::size_t n) { device.near_mm[n] = 0; });
  }
  return tick;
}

ViewedState Veil::of(ViewedState state) const {
  const std::vector<ViewedTissueState> tissues = state.tissues;
  for (std::size_t t = 0; t < std::min(tissues.size(), tissue_as_.size()); ++t)
    if (const auto as = static_cast<std::size_t>(tissue_as_[t]); as < tissues.size())
      state.tissues[t] = tissues[as];
  const auto hidden = [this](const auto& entry) { return is_hidden(entry.first); };
  std::erase_if(state.removed_mm3, hidden);
  std::erase_if(state.nearest_mm, hidden);
  return state;
}

}  // namespace palpate::link
