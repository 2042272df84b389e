#include "report/contacts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

namespace palpate::report {
namespace {

double squared_norm(const std::array<double, 3>& v) {
  return v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
}

double norm(const std::array<double, 3>& v) {
  const double squared = squared_norm(v);
  return std::isfinite(squared) ? std::sqrt(squared) : 0.0;
}

/// Whether the force is within both limits up to the rounding of the clamp; false if it is not finite.
bool is_within_limits(const DeviceTick& device, double max_force_N) {
  const double sent_N = std::sqrt(squared_norm(device.force_N));
  return sent_N <= max_force_N * (1 + 1e-9) && sent_N <= device.limit_N * (1 + 1e-9);
}

bool touches(const DeviceTick& device) {
  return (device.flags & kFlagContact) != 0 && device.label != 0;
}

}  // namespace

int device_count(const RecordingHead& head) {
  return std::clamp(head.header.devices, 1, kMaxDevices);
}

double force_N(const DeviceTick& device) {
  return norm(device.force_N);
}

void ContactFinder::observe(const TimedTick& now) {
  for (std::size_t d = 0; d < open_.size(); ++d) {
    const DeviceTick& device = now.tick.device[d];
    std::optional<Contact>& contact = open_[d];
    if (contact && (!touches(device) || device.label != contact->label)) close(contact);
    if (!touches(device)) continue;
    // extend the contact while the structure stays the same
    const double force = force_N(device);
    if (!contact)
      contact = Contact{.device = static_cast<int>(d),
                        .label = device.label,
                        .first = now.index,
                        .last = now.index,
                        .peak = now.index,
                        .begin_s = now.begin_s,
                        .end_s = now.end_s,
                        .first_touch_mm = device.proxy_patient_mm,
                        .peak_force_N = force,
                        .peak_s = now.begin_s};
    contact->last = now.index;
    contact->end_s = now.end_s;
    if (!(force > contact->peak_force_N)) continue;
    contact->peak = now.index;
    contact->peak_force_N = force;
    contact->peak_s = now.begin_s;
  }
}

void ContactFinder::close(std::optional<Contact>& contact) {
  // tolerance for rounding of the clock
  if (contact && contact->duration_s() >= shortest_s_ - 1e-9) found_.push_back(*contact);
  contact.reset();
}

std::vector<Contact> ContactFinder::finish() {
  for (std::optional<Contact>& contact : open_) close(contact);
  std::sort(found_.begin(), found_.end(), [](const Contact& a, const Contact& b) {
    return std::pair(a.first, a.device) < std::pair(b.first, b.device);
  });
  return std::move(found_);
}

bool is_deeper_than_measured(const DeviceTick& device, const Model& model) {
  const std::vector<float>& levels = model.level_of_label;
  const double level = device.label < levels.size() ? levels[device.label] : 0;
  return std::isnan(device.depth_mm) && !(device.field < 0.5 * level);
}

void StructureMeter::observe(const TimedTick& now) {
  const double dt_s = now.end_s - now.begin_s;
  for (int d = 0; d < devices_; ++d) {
    const DeviceTick& device = now.tick.device[d];
    if (!touches(device)) continue;
    const auto [found, added] = index_of_label_.emplace(device.label, figures_.size());
    if (added) figures_.push_back({.label = device.label});
    StructureFigures& figure = figures_[found->second];
    figure.contact_s += dt_s;
    figure.mean_force_N += force_N(device) * dt_s;
    figure.peak_force_N = std::max(figure.peak_force_N, force_N(device));
    // fmax ignores NaN
    if (std::isfinite(device.depth_mm)) figure.max_depth_mm = std::fmax(figure.max_depth_mm, device.depth_mm);
    figure.in_front = figure.in_front || device.depth_mm < 0;
    figure.depth_has_gaps = figure.depth_has_gaps || std::isnan(device.depth_mm);
    figure.deeper_than_measured = figure.deeper_than_measured || is_deeper_than_measured(device, model_);
    figure.mean_speed_mm_s += norm(device.velocity_patient_mm_s) * dt_s;
  }
}

std::vector<StructureFigures> StructureMeter::finish(const std::vector<Contact>& contacts) {
  for (const Contact& contact : contacts) figures_[index_of_label_.at(contact.label)].contacts += 1;
  for (StructureFigures& figure : figures_) {
    figure.mean_force_N /= figure.contact_s;
    figure.mean_speed_mm_s /= figure.contact_s;
  }
  return std::move(figures_);
}

void BeneathMeter::observe(const TimedTick& now) {
  for (int d = 0; d < devices_; ++d) {
    const DeviceTick& device = now.tick.device[d];
    if (!touches(device)) continue;
    for (std::size_t n = 0; n < device.path_label.size(); ++n) {
      const LabelId label = device.path_label[n];
      // values are unchecked: the file may be damaged
      const double contributed_N = device.path_share[n] * force_N(device);
      if (label == 0 || label == device.label || !std::isfinite(contributed_N)) continue;
      const auto [found, added] = index_of_label_.emplace(label, figures_.size());
      if (added) figures_.push_back({.label = label});
      DeepFigures& figures = figures_[found->second];
      figures.time_s += now.end_s - now.begin_s;
      figures.peak_force_N = std::max(figures.peak_force_N, contributed_N);
      figures.max_depth_mm = std::fmax(figures.max_depth_mm, device.path_depth_mm[n]);
    }
  }
}

std::vector<Contact> main_contacts(const std::vector<Contact>& contacts,
                                   const std::vector<StructureFigures>& structures, std::size_t max_count) {
  // longest contact of each structure
  std::map<LabelId, Contact> longest;
  for (const Contact& contact : contacts) {
    const auto [found, added] = longest.emplace(contact.label, contact);
    if (!added && contact.duration_s() > found->second.duration_s()) found->second = contact;
  }

  // structures by total contact duration
  std::vector<StructureFigures> ranked = structures;
  std::stable_sort(ranked.begin(), ranked.end(), [](const StructureFigures& a, const StructureFigures& b) {
    return a.contact_s > b.contact_s;
  });
  std::vector<Contact> chosen;
  for (const StructureFigures& figure : ranked) {
    const auto found = longest.find(figure.label);
    if (found != longest.end() && chosen.size() < max_count) chosen.push_back(found->second);
  }
  std::stable_sort(chosen.begin(), chosen.end(),
                   [](const Contact& a, const Contact& b) { return a.first < b.first; });
  return chosen;
}

void SummaryMeter::observe(const TickRecord& tick) {
  if (counted_.ticks == 0) first_tick_ = tick.tick;
  last_tick_ = tick.tick;
  counted_.observe(tick);
}

RecordingSummary SummaryMeter::finish(const RecordingHead& head) const {
  if (head.summary) return *head.summary;
  RecordingSummary summary = counted_;
  if (summary.ticks > 0) {
    const std::uint64_t computed = last_tick_ - first_tick_ + 1;
    summary.dropped = computed > summary.ticks ? computed - summary.ticks : 0;
  }
  return summary;
}

void TickCount::observe(const TickRecord& tick, int devices) {
  const auto own = std::span(tick.device).first(static_cast<std::size_t>(devices));
  ticks += std::ranges::any_of(own, [&](const DeviceTick& device) { return (device.flags & flags) != 0; });
}

double limit_N(const DeviceTick& device) {
  const bool withheld = (device.flags & (kFaultFlags | kFlagStale)) != 0;
  return withheld ? std::numeric_limits<double>::quiet_NaN() : device.limit_N;
}

void ForceExtremes::observe(const TickRecord& tick, int devices) {
  bool within_limits = true;
  for (int d = 0; d < devices; ++d) {
    const DeviceTick& device = tick.device[static_cast<std::size_t>(d)];
    peak_N = std::max(peak_N, force_N(device));
    max_heat = std::fmax(max_heat, device.heat);
    within_limits = within_limits && is_within_limits(device, tick.max_force_N);
    const double limit = limit_N(device);
    if (!std::isfinite(limit)) continue;
    lowest_limit_N = limited ? std::min(lowest_limit_N, limit) : limit;
    highest_limit_N = limited ? std::max(highest_limit_N, limit) : limit;
    limited = true;
  }
  above_limit += !within_limits;
}

}  // namespace palpate::report
