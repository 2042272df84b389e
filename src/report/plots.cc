#include <cmath>
#include <limits>

#include "report/decimate.h"
#include "report/html.h"
#include "report/parts.h"

namespace palpate::report {
namespace {

constexpr std::size_t kMostPoints = 4000;
constexpr double kGap = std::numeric_limits<double>::quiet_NaN();

double speed_mm_s(const DeviceTick& device) {
  const auto& v = device.velocity_patient_mm_s;
  return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

template <class Value>
std::vector<double> over_ticks(const Run& run, Value value) {
  std::vector<double> series;
  series.reserve(run.recording.ticks.size());
  for (const TickRecord& tick : run.recording.ticks) series.push_back(value(tick));
  return series;
}

/// Of each device limit, force, depth and speed, then, on the real clock, the lateness in microseconds. Depth
/// only while something is touched.
constexpr std::size_t kQuantities = 4;
PlotData plot_data(const Run& run) {
  PlotData data;
  data.x.assign(run.edges_s.begin(), run.edges_s.end() - 1);
  for (std::size_t d = 0; d < static_cast<std::size_t>(device_count(run.recording)); ++d) {
    const auto add = [&](auto value) {
      data.series.push_back(over_ticks(run, [&](const TickRecord& tick) { return value(tick.device[d]); }));
    };
    add(limit_N);
    add(force_N);
    add([](const DeviceTick& device) { return (device.flags & kFlagContact) != 0 ? device.depth_mm : kGap; });
    add(speed_mm_s);
  }
  if (run.real_clock())
    data.series.push_back(over_ticks(run, [](const TickRecord& tick) { return 1e6 * tick.lateness_s; }));
  return decimate(std::move(data), kMostPoints);
}

std::string json_array(const std::vector<double>& values, int decimals) {
  std::string json = "[";
  for (const double value : values) {
    if (json.size() > 1) json += ',';
    json += json_number(value, decimals);
  }
  return json + "]";
}

std::string contacts_json(const Run& run) {
  std::string json = "[";
  for (const Contact& contact : run.contacts) {
    if (json.size() > 1) json += ',';
    json += "{\"begin\":" + json_number(contact.begin_s(run.edges_s), 4) +
            ",\"end\":" + json_number(contact.end_s(run.edges_s), 4) +
            ",\"colour\":" + json_string(css_colour(run.colour(contact.label))) +
            ",\"name\":" + json_string(run.name(contact.label)) + "}";
  }
  return json + "]";
}

/// Begin and end of each shown contact, in the order of the tabs.
std::string shown_json(const Run& run) {
  std::vector<double> begins, ends;
  for (const Contact& contact : run.shown) {
    begins.push_back(contact.begin_s(run.edges_s));
    ends.push_back(contact.end_s(run.edges_s));
  }
  return "{\"begin\":" + json_array(begins, 4) + ",\"end\":" + json_array(ends, 4) + "}";
}

/// One array a device; `quantity` counts from 0 as plot_data() orders them.
std::string devices_json(const PlotData& data, std::size_t quantity, int decimals) {
  std::string json = "[";
  for (std::size_t d = 0; d < data.series.size() / kQuantities; ++d) {
    if (json.size() > 1) json += ',';
    json += json_array(data.series[d * kQuantities + quantity], decimals);
  }
  return json + "]";
}

std::string data_json(const Run& run) {
  const PlotData data = plot_data(run);
  std::string json = "{\"time\":" + json_array(data.x, 4);
  json += ",\"limit\":" + devices_json(data, 0, 3);
  json += ",\"force\":" + devices_json(data, 1, 3);
  json += ",\"depth\":" + devices_json(data, 2, 3);
  json += ",\"speed\":" + devices_json(data, 3, 2);
  if (run.real_clock()) json += ",\"lateness\":[" + json_array(data.series.back(), 1) + "]";
  json += ",\"contacts\":" + contacts_json(run);
  json += ",\"shown\":" + shown_json(run);
  return json + "}";
}

std::string plot(const std::string& id, const std::string& title, const std::string& description) {
  return "<div class=\"plot\"><h3 id=\"" + id + "-title\">" + title +
         "</h3><div class=\"canvas\" id=\"plot-" + id + "\" role=\"img\" aria-label=\"" +
         escape(description) + "\"></div></div>\n";
}

/// "; largest 0.90 mm"
std::string deepest_text(const Run& run) {
  double deepest = kGap;
  for (const StructureFigures& figure : run.structures) deepest = std::fmax(deepest, figure.max_depth_mm);
  std::string text;
  if (std::isfinite(deepest)) text += "; largest " + number(deepest, 2) + " mm";
  if (run.deeper_than_measured()) text += "; in places deeper than measured";
  return text;
}

}  // namespace

std::string plots_html(const Run& run) {
  std::string html =
      "<section class=\"card\" aria-labelledby=\"plots-title\"><h2 id=\"plots-title\">Over time</h2>\n";
  if (run.recording.ticks.empty()) {
    return html + "<p class=\"empty\">The recording holds no tick.</p></section>\n";
  }
  html +=
      "<p class=\"hint\">Shaded: contacts, in the structure's colour. Drag to zoom, double-click to see all.";
  if (run.felt_in_front()) html += " A negative depth is felt in the smoothed rim, in front of the surface.";
  if (run.depth_has_gaps()) html += " Where its curve has a gap in a contact, no surface was within reach.";
  html += "</p>\n";
  const std::string duration = " over " + number(run.duration_s(), 1) + " s";
  html += plot("force", "Force sent <span class=\"unit\">N</span>",
               "Force sent" + duration + "; largest " + number(run.forces.peak_N, 2) + " N, limit " +
                   number(run.forces.highest_limit_N, 2) + " N");
  html += plot("depth", "Depth below the surface <span class=\"unit\">mm</span>",
               "Depth of the tip below the touched surface" + duration + deepest_text(run));
  html += plot("speed", "Speed of the tip <span class=\"unit\">mm/s</span>", "Speed of the tip" + duration);
  html += "<ul class=\"legend\" aria-label=\"Structures touched\">";
  for (const StructureFigures& figure : run.structures) {
    html += "<li>" + swatch(run.colour(figure.label)) + escape(run.name(figure.label)) + "</li>";
  }
  return html +
         "</ul>\n<noscript><p class=\"empty\">The plots need JavaScript.</p></noscript>\n"
         "<script type=\"application/json\" id=\"run-data\">" +
         data_json(run) + "</script></section>\n";
}

}  // namespace palpate::report
