#include "palpate/report/moment.h"

#include <algorithm>
#include <cmath>
#include <deque>

#include "palpate/rendering/rendering.h"
#include "palpate/tissue/displaced_tissue.h"
#include "palpate/tissue/displayed_law.h"
#include "palpate/tissue/tissue_laws.h"
#include "report/contacts.h"
#include "report/page_sections.h"
#include "report/removal_figures.h"
#include "report/timed_ticks.h"
#include "report/tool_marks.h"

namespace palpate {
namespace {

constexpr double kPathBefore_s = 2;
constexpr double kTipFraction = 0.005;
constexpr Rgb kTipColour{255, 255, 255};

/// Tip positions of the last kPathBefore_s.
class RecentTips {
 public:
  explicit RecentTips(int devices) : devices_(static_cast<std::size_t>(devices)) {}
  void observe(const report::TimedTick& now) {
    Observed observed{now.begin_s, {}, {}};
    for (std::size_t d = 0; d < devices_; ++d) {
      const auto& at = now.tick.device[d].tip_patient_mm;
      observed.tip[d] = {at[0], at[1], at[2]};
      observed.touching[d] = (now.tick.device[d].flags & kFlagContact) != 0;
    }
    observed_.push_back(observed);
    while (observed_.front().time_s < now.begin_s - kPathBefore_s) observed_.pop_front();
  }
  std::vector<RecordedMoment::PathSection> paths() const {
    std::vector<RecordedMoment::PathSection> paths;
    for (std::size_t d = 0; d < devices_; ++d) {
      const Observed* before = nullptr;
      for (const Observed& observed : observed_) {
        if (before == nullptr || before->touching[d] != observed.touching[d]) {
          paths.push_back({observed.touching[d], {}});
          // adjacent sections share a point
          if (before != nullptr) paths.back().points.push_back(before->tip[d]);
        }
        paths.back().points.push_back(observed.tip[d]);
        before = &observed;
      }
    }
    return paths;
  }

 private:
  struct Observed {
    double time_s;
    std::array<Point<Patient>, kMaxDevices> tip;
    std::array<bool, kMaxDevices> touching;
  };
  std::size_t devices_;
  std::deque<Observed> observed_;
};

/// The model with its labels displaced by the deformation.
std::shared_ptr<const Model> displaced_model(const Model& model, const DisplacedTissue& deformed) {
  const Bricks<LabelId>& labels = *model.labels;
  const auto moved = [&deformed](const Point<Patient>& at_rest) { return deformed.displacement_mm(at_rest); };
  const PatchOf<LabelId> patch = moved_labels(labels, moved, {{0, 0, 0}, labels.geometry().dims});
  auto displaced = std::make_shared<Model>(model);
  displaced->surfaces.clear();
  displaced->label_of_surface.clear();
  if (patch.box.voxel_count() > 0) displaced->labels = std::make_shared<Bricks<LabelId>>(labels.with(patch));
  return displaced;
}

void show_deformation(const Model& model, TissueLaw law, RecordedMoment& moment) {
  if (model.labels == nullptr || !is_elastic(law)) return;
  const Model under =
      displayed_under_law(moment.current_model != nullptr ? *moment.current_model : model, law);
  const DisplacedTissue deformed(under, moment.tick);
  if (deformed.is_at_rest()) return;
  for (int device = 0; device < moment.devices; ++device) {
    const auto& contact_mm = moment.tick.device[static_cast<std::size_t>(device)].contact_patient_mm;
    moment.dent_mm[static_cast<std::size_t>(device)] =
        deformed.displacement_mm(Point<Patient>(contact_mm[0], contact_mm[1], contact_mm[2]));
  }
  moment.current_model = displaced_model(under, deformed);
}

/// Stops reading once all required ticks were read.
Error enough() {
  return {ErrorKind::kInterrupted, "enough", "", ""};
}

}  // namespace

Result<RecordedMoment> recorded_moment(const RecordingSource& recording, const Model& model, double time_s,
                                       const Progress& progress) {
  const RecordingHead& head = recording.head();
  if (auto same = report::check_model(head.header, model); !same) return same.error();
  RecordedMoment moment;
  moment.devices = report::device_count(head);
  report::TickTimes times(head);
  RecentTips tips(moment.devices);
  report::RemovalMeter removal(model);
  LawHistory laws(model.tissue_law);
  bool any = false, is_over = false;
  double done = 0;
  const auto observe = [&](const report::TimedTick& now) {
    is_over = is_over || (any && now.begin_s > time_s);
    if (is_over) return;
    any = true;
    moment.time_s = now.begin_s;
    moment.tick = now.tick;
    tips.observe(now);
    removal.observe(now);
    for (int d = 0; d < moment.devices; ++d) {
      const double limit = now.tick.device[static_cast<std::size_t>(d)].limit_N;
      if (std::isfinite(limit)) moment.highest_limit_N = std::max(moment.highest_limit_N, limit);
    }
  };
  const auto read = recording.read(
      [&](const RecordingPart& part) -> Result<void> {
        progress.report("reading the recording",
                        done / static_cast<double>(std::max<std::uint64_t>(1, head.ticks)));
        done += static_cast<double>(part.ticks.size());
        removal.on_event(part.events);
        for (const RecordingEvent& event : part.events)
          if (event.kind == RecordingEvent::Kind::kModel) laws.on_event(event.change);
        times.take(part.ticks, observe);
        return is_over ? Result<void>(enough()) : Result<void>();
      },
      progress);
  if (!read && !is_over) return read.error();
  if (!is_over) times.finish(observe);
  if (!any)
    return Error{ErrorKind::kBadInput, "the recording has no ticks", "",
                 "choose a recording of a longer run"};
  moment.paths = tips.paths();
  const report::RemovalFigures figures = removal.finish();
  moment.current_model = report::model_after_removal(model, figures.changes, moment.time_s);
  show_deformation(model, laws.at(moment.tick.model_version), moment);
  return moment;
}

std::vector<VolumeMark> moment_marks(const RecordedMoment& moment, const Model& model,
                                     const VolumeCamera& camera) {
  std::vector<VolumeMark> marks;
  for (const RecordedMoment::PathSection& section : moment.paths)
    add_path(marks, section.points, section.touching ? 2.2 : 1.5,
             section.touching ? report::kTouchingPathColour : report::kFreePathColour, report::kPathBehind,
             camera);
  const double mm_per_N = report::arrow_mm_per_N(moment.highest_limit_N);
  for (int device = 0; device < moment.devices; ++device) {
    const Vector<Patient>& dent = moment.dent_mm[static_cast<std::size_t>(device)];
    const Point<Patient> proxy = report::proxy_position(moment.tick, device) + dent;
    const auto& at = moment.tick.device[static_cast<std::size_t>(device)].tip_patient_mm;
    const Point<Patient> tip(at[0], at[1], at[2]);
    if (!proxy.eigen().allFinite() || !tip.eigen().allFinite()) continue;
    const std::size_t first = marks.size();
    report::add_tool(marks, model, moment.tick, device);
    for (std::size_t n = first; n < marks.size(); ++n) {
      marks[n].from += dent;
      marks[n].to += dent;
    }
    const double proxy_mm = report::kPositionFraction * camera.width_mm,
                 tip_mm = kTipFraction * camera.width_mm;
    marks.push_back({proxy, proxy, proxy_mm, proxy_mm, report::kPositionColour, report::kPositionBehind});
    marks.push_back({tip, tip, tip_mm, tip_mm, kTipColour, report::kPositionBehind});
    const Vector<Patient> force_N = report::patient_force_N(model, moment.tick, device);
    if (force_N.eigen().allFinite())
      add_arrow(marks, proxy, force_N * mm_per_N, report::kArrowFraction * camera.width_mm,
                report::kForceColour);
  }
  return marks;
}

}  // namespace palpate
