#include "report/run.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "report/html.h"

namespace palpate::report {
namespace {

const RecordingHeader::Structure* find_structure(const RecordingHead& recording, LabelId label) {
  const auto& structures = recording.header.structures;
  const auto found = std::find_if(structures.begin(), structures.end(),
                                  [&](const RecordingHeader::Structure& s) { return s.label == label; });
  return found == structures.end() ? nullptr : &*found;
}

constexpr std::size_t kMaxPoints = 4000;
constexpr std::size_t kMaxPlotted = 12;

double speed_mm_s(const DeviceTick& device) {
  const auto& v = device.velocity_patient_mm_s;
  return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

/// Plotted values of one tick, in the order of Run::plots. The depth is a gap without contact.
void plotted_values(const Run& run, const TickRecord& tick, std::vector<double>& values) {
  values.clear();
  for (std::size_t d = 0; d < static_cast<std::size_t>(run.devices); ++d) {
    const DeviceTick& device = tick.device[d];
    const double depth_mm = (device.flags & kFlagContact) != 0 ? device.depth_mm : kGap;
    values.insert(values.end(), {limit_N(device), force_N(device), depth_mm, speed_mm_s(device)});
  }
  if (run.real_clock()) values.push_back(1e6 * tick.lateness_s);
}

/// Calls `observe` for every tick with its times.
/// @param on_event  called with events, before the first tick that follows them
template <class OnEvent, class OnTick>
Result<void> read_timed(const RecordingSource& recording, const char* stage, const Progress& progress,
                        OnEvent&& on_event, OnTick&& observe) {
  TickTimes times(recording.head());
  double done = 0;
  const auto read = recording.read(
      [&](const RecordingPart& part) -> Result<void> {
        progress.report(stage, done / static_cast<double>(recording.head().ticks));
        done += static_cast<double>(part.ticks.size());
        on_event(part.events);
        times.take(part.ticks, observe);
        return {};
      },
      progress);
  if (read) times.finish(observe);
  return read;
}

Result<void> read_figures(const RecordingSource& recording, const Progress& progress, Run& run) {
  const RecordingHead& head = recording.head();
  ContactFinder contacts(run.devices);
  StructureMeter structures(run.devices, run.model);
  BeneathMeter beneath(run.devices);
  SummaryMeter summary;
  RemovalMeter removal(run.model);
  Decimator plots(static_cast<std::size_t>(head.ticks),
                  kQuantities * static_cast<std::size_t>(run.devices) + run.real_clock(), kMaxPoints);
  std::vector<double> values;
  double begin_s = 0;
  const auto on_event = [&](std::span<const RecordingEvent> events) {
    removal.on_event(events);
    for (const RecordingEvent& event : events)
      if (event.kind == RecordingEvent::Kind::kModel) run.laws.on_event(event.change);
  };
  const auto read =
      read_timed(recording, "reading the recording", progress, on_event, [&](const TimedTick& now) {
        if (now.index == 0) {
          run.first = now.tick;
          begin_s = now.begin_s;
        }
        run.duration_s = now.end_s - begin_s;
        contacts.observe(now);
        structures.observe(now);
        beneath.observe(now);
        summary.observe(now.tick);
        for (TickCount* count : {&run.interventions, &run.invalid, &run.other})
          count->observe(now.tick, run.devices);
        run.forces.observe(now.tick, run.devices);
        run.lateness.add(now.tick.lateness_s);
        run.compute.add(now.tick.compute_s);
        run.rate.observe(now);
        removal.observe(now);
        plotted_values(run, now.tick, values);
        plots.add(now.begin_s, values);
      });
  if (!read) return read;
  run.contacts = contacts.finish();
  run.structures = structures.finish(run.contacts);
  run.beneath = beneath.finish();
  run.summary = summary.finish(head);
  run.removal = removal.finish();
  run.plots = plots.finish();
  return {};
}

/// Structures with a plotted force contribution, touched ones first.
std::vector<LabelId> touchable_labels(const Run& run) {
  std::vector<LabelId> labels;
  const auto add = [&](LabelId label) {
    if (std::ranges::find(labels, label) == labels.end() && labels.size() < kMaxPlotted)
      labels.push_back(label);
  };
  if (!run.is_deformable()) return labels;
  for (const StructureFigures& figure : run.structures) add(figure.label);
  for (const DeepFigures& figure : run.beneath) add(figure.label);
  return labels;
}

/// Values of Run::layers for one tick.
void layer_values(const Run& run, const TickRecord& tick, std::vector<double>& values) {
  const std::size_t count = run.layer_labels.size();
  values.assign(2 * count, kGap);
  for (std::size_t d = 0; d < static_cast<std::size_t>(run.devices); ++d) {
    const DeviceTick& device = tick.device[d];
    for (std::size_t n = 0; n < device.path_label.size() && device.path_label[n] != 0; ++n) {
      const auto found = std::ranges::find(run.layer_labels, device.path_label[n]);
      if (found == run.layer_labels.end()) continue;
      const auto at = static_cast<std::size_t>(found - run.layer_labels.begin());
      double &force = values[at], &depth = values[count + at];
      const double its_N = force_N(device) * device.path_share[n];
      force = std::isfinite(force) ? force + its_N : its_N;
      depth = std::fmax(depth, device.path_depth_mm[n]);
    }
  }
}

Result<void> follow_contacts(const RecordingSource& recording, const Progress& progress, Run& run) {
  if (run.shown.empty()) return {};
  std::vector<PathRecorder> followers;
  for (const ShownContact& shown : run.shown) followers.emplace_back(shown.contact);
  run.layer_labels = touchable_labels(run);
  Decimator layers(static_cast<std::size_t>(run.recording.ticks), 2 * run.layer_labels.size(), kMaxPoints);
  std::vector<double> values;
  const auto on_event = [](std::span<const RecordingEvent>) {};
  const auto read =
      read_timed(recording, "extracting the contacts", progress, on_event, [&](const TimedTick& now) {
        for (std::size_t i = 0; i < followers.size(); ++i) {
          followers[i].observe(now);
          if (run.shown[i].contact.peak == now.index) run.shown[i].peak = now.tick;
        }
        if (run.layer_labels.empty()) return;
        layer_values(run, now.tick, values);
        layers.add(now.begin_s, values);
      });
  if (read && !run.layer_labels.empty()) run.layers = layers.finish();
  for (std::size_t i = 0; i < followers.size(); ++i) run.shown[i].paths = followers[i].finish();
  return read;
}

}  // namespace

Result<Run> read_run(const RecordingSource& recording, const Model& model, const Progress& progress) {
  Run run(recording.head(), model);
  if (auto read = read_figures(recording, progress, run); !read) return read.error();
  for (const Contact& contact : main_contacts(run.contacts, run.structures, kMaxShown))
    run.shown.push_back({contact, {}, {}});
  if (auto read = follow_contacts(recording, progress, run); !read) return read.error();
  return run;
}

bool Run::touched_in_front() const {
  return std::any_of(structures.begin(), structures.end(),
                     [](const StructureFigures& figure) { return figure.in_front; });
}

bool Run::depth_has_gaps() const {
  return std::any_of(structures.begin(), structures.end(),
                     [](const StructureFigures& figure) { return figure.depth_has_gaps; });
}

bool Run::deeper_than_measured() const {
  return std::any_of(structures.begin(), structures.end(),
                     [](const StructureFigures& figure) { return figure.deeper_than_measured; });
}

std::string Run::name(LabelId label) const {
  const RecordingHeader::Structure* structure = find_structure(recording, label);
  if (structure != nullptr && !structure->name.empty()) return structure->name;
  return model.name_of(label);
}

Rgb Run::colour(LabelId label) const {
  if (const Segment* segment = model.find(label)) return segment->colour;
  const RecordingHeader::Structure* structure = find_structure(recording, label);
  return structure != nullptr ? structure->colour : Rgb{};
}

std::string swatch(const Rgb& colour) {
  return "<svg class=\"swatch\" viewBox=\"0 0 10 10\" aria-hidden=\"true\"><rect width=\"10\" height=\"10\" "
         "rx=\"2\" "
         "fill=\"" +
         css_colour(colour) + "\"/></svg>";
}

}  // namespace palpate::report
