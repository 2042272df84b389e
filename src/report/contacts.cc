#include "report/contacts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <span>

namespace palpate::report {
namespace {

double squared_norm(const std::array<double, 3>& v) {
  return v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
}

double norm(const std::array<double, 3>& v) {
  const double squared = squared_norm(v);
  return std::isfinite(squared) ? std::sqrt(squared) : 0.0;
}

/// Within both limits but for the rounding of the clamp; what is not a number is not.
bool is_within_limits(const DeviceTick& device, double max_force_N) {
  const double sent_N = std::sqrt(squared_norm(device.force_N));
  return sent_N <= max_force_N * (1 + 1e-9) && sent_N <= device.limit_N * (1 + 1e-9);
}

bool touches(const DeviceTick& device) {
  return (device.flags & kFlagContact) != 0 && device.label != 0;
}

/// Adds one device's contacts in the order of time.
void find_contacts_of(const Recording& recording, const std::vector<double>& edges_s, int device,
                      double shortest_s, std::vector<Contact>& contacts) {
  const std::vector<TickRecord>& ticks = recording.ticks;
  for (std::size_t i = 0; i < ticks.size();) {
    if (!touches(ticks[i].device[device])) {
      ++i;
      continue;
    }
    // follow the structure as far as it goes
    Contact contact{device, ticks[i].device[device].label, i, i, i};
    for (; i < ticks.size(); ++i) {
      const DeviceTick& now = ticks[i].device[device];
      if (!touches(now) || now.label != contact.label) break;
      contact.last = i;
      if (force_N(now) > force_N(ticks[contact.peak].device[device])) contact.peak = i;
    }
    // a rounding of the clock does not make a contact too short
    if (contact.duration_s(edges_s) >= shortest_s - 1e-9) contacts.push_back(contact);
  }
}

}  // namespace

std::vector<double> tick_edges_s(const Recording& recording) {
  const std::size_t n = recording.ticks.size();
  const double rate_hz = recording.header.rate_hz;
  const double period_s = std::isfinite(rate_hz) && rate_hz > 0 ? 1 / rate_hz : 1e-3;
  std::vector<double> edges(n + 1);
  bool increasing = true;
  for (std::size_t i = 0; i < n; ++i) {
    edges[i] = recording.ticks[i].time_s;
    increasing = increasing && std::isfinite(edges[i]) && (i == 0 || edges[i] > edges[i - 1]);
  }
  if (!increasing) {
    for (std::size_t i = 0; i < n; ++i) edges[i] = static_cast<double>(i) * period_s;
  }
  if (n > 0) edges[n] = edges[n - 1] + (n > 1 ? edges[n - 1] - edges[n - 2] : period_s);
  return edges;
}

int device_count(const Recording& recording) {
  return std::clamp(recording.header.devices, 1, 4);
}

double force_N(const DeviceTick& device) {
  return norm(device.force_N);
}

std::vector<Contact> find_contacts(const Recording& recording, const std::vector<double>& edges_s,
                                   double shortest_s) {
  std::vector<Contact> contacts;
  for (int device = 0; device < device_count(recording); ++device) {
    find_contacts_of(recording, edges_s, device, shortest_s, contacts);
  }
  std::stable_sort(contacts.begin(), contacts.end(),
                   [](const Contact& a, const Contact& b) { return a.first < b.first; });
  return contacts;
}

bool is_deeper_than_measured(const DeviceTick& device, const Model& model) {
  const std::vector<float>& levels = model.level_of_label;
  const double level = device.label < levels.size() ? levels[device.label] : 0;
  return std::isnan(device.depth_mm) && !(device.field < 0.5 * level);
}

std::vector<StructureFigures> summarise_structures(const Recording& recording, const Model& model,
                                                   const std::vector<double>& edges_s,
                                                   const std::vector<Contact>& contacts) {
  // sums first, means at the end
  std::vector<StructureFigures> figures;
  std::map<LabelId, std::size_t> place;
  for (std::size_t i = 0; i < recording.ticks.size(); ++i) {
    const double dt_s = edges_s[i + 1] - edges_s[i];
    for (int d = 0; d < device_count(recording); ++d) {
      const DeviceTick& device = recording.ticks[i].device[d];
      if (!touches(device)) continue;
      const auto [found, added] = place.emplace(device.label, figures.size());
      if (added) figures.push_back({.label = device.label});
      StructureFigures& figure = figures[found->second];
      figure.contact_s += dt_s;
      figure.mean_force_N += force_N(device) * dt_s;
      figure.peak_force_N = std::max(figure.peak_force_N, force_N(device));
      // fmax passes over a NaN on either side
      if (std::isfinite(device.depth_mm))
        figure.max_depth_mm = std::fmax(figure.max_depth_mm, device.depth_mm);
      figure.in_front = figure.in_front || device.depth_mm < 0;
      figure.depth_has_gaps = figure.depth_has_gaps || std::isnan(device.depth_mm);
      figure.deeper_than_measured = figure.deeper_than_measured || is_deeper_than_measured(device, model);
      figure.mean_speed_mm_s += norm(device.velocity_patient_mm_s) * dt_s;
    }
  }
  for (const Contact& contact : contacts) figures[place.at(contact.label)].contacts += 1;
  for (StructureFigures& figure : figures) {
    figure.mean_force_N /= figure.contact_s;
    figure.mean_speed_mm_s /= figure.contact_s;
  }
  return figures;
}

std::vector<Contact> main_contacts(const std::vector<Contact>& contacts,
                                   const std::vector<StructureFigures>& structures,
                                   const std::vector<double>& edges_s, std::size_t most) {
  // the longest of each structure
  std::map<LabelId, Contact> longest;
  for (const Contact& contact : contacts) {
    const auto [found, added] = longest.emplace(contact.label, contact);
    if (!added && contact.duration_s(edges_s) > found->second.duration_s(edges_s)) found->second = contact;
  }

  // the structures that were touched longest
  std::vector<StructureFigures> ranked = structures;
  std::stable_sort(ranked.begin(), ranked.end(), [](const StructureFigures& a, const StructureFigures& b) {
    return a.contact_s > b.contact_s;
  });
  std::vector<Contact> chosen;
  for (const StructureFigures& figure : ranked) {
    const auto found = longest.find(figure.label);
    if (found != longest.end() && chosen.size() < most) chosen.push_back(found->second);
  }
  std::stable_sort(chosen.begin(), chosen.end(),
                   [](const Contact& a, const Contact& b) { return a.first < b.first; });
  return chosen;
}

RecordingSummary summary_of(const Recording& recording) {
  if (recording.summary) return *recording.summary;
  RecordingSummary summary;
  for (const TickRecord& tick : recording.ticks) summary.see(tick);
  if (!recording.ticks.empty()) {
    const std::uint64_t computed = recording.ticks.back().tick - recording.ticks.front().tick + 1;
    summary.dropped = computed > summary.ticks ? computed - summary.ticks : 0;
  }
  return summary;
}

std::uint64_t count_ticks_with(const Recording& recording, std::uint32_t flags) {
  const auto has = [&](const TickRecord& tick) {
    const auto devices = std::span(tick.device).first(static_cast<std::size_t>(device_count(recording)));
    return std::ranges::any_of(devices,
                               [&](const DeviceTick& device) { return (device.flags & flags) != 0; });
  };
  return static_cast<std::uint64_t>(std::ranges::count_if(recording.ticks, has));
}

double limit_N(const DeviceTick& device) {
  const bool withheld = (device.flags & (kFaultFlags | kFlagStale)) != 0;
  return withheld ? std::numeric_limits<double>::quiet_NaN() : device.limit_N;
}

ForceExtremes force_extremes(const Recording& recording) {
  ForceExtremes extremes;
  bool first = true;
  for (const TickRecord& tick : recording.ticks) {
    bool within_limits = true;
    for (int d = 0; d < device_count(recording); ++d) {
      const DeviceTick& device = tick.device[static_cast<std::size_t>(d)];
      extremes.peak_N = std::max(extremes.peak_N, force_N(device));
      extremes.most_heat = std::fmax(extremes.most_heat, device.heat);
      within_limits = within_limits && is_within_limits(device, tick.max_force_N);
      const double limit = limit_N(device);
      if (!std::isfinite(limit)) continue;
      extremes.lowest_limit_N = first ? limit : std::min(extremes.lowest_limit_N, limit);
      extremes.highest_limit_N = first ? limit : std::max(extremes.highest_limit_N, limit);
      first = false;
    }
    extremes.above_limit += !within_limits;
  }
  return extremes;
}

}  // namespace palpate::report
