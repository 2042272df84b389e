#include <cmath>
#include <limits>

#include "report/html.h"
#include "report/page_sections.h"

namespace palpate::report {
namespace {

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
    json += "{\"begin\":" + json_number(contact.begin_s, 4) + ",\"end\":" + json_number(contact.end_s, 4) +
            ",\"colour\":" + json_string(css_colour(run.colour(contact.label))) +
            ",\"name\":" + json_string(run.name(contact.label)) + "}";
  }
  return json + "]";
}

/// Begin and end times of each shown contact, in the order of the tabs.
std::string shown_json(const Run& run) {
  std::vector<double> begins, ends;
  for (const ShownContact& shown : run.shown) {
    begins.push_back(shown.contact.begin_s);
    ends.push_back(shown.contact.end_s);
  }
  return "{\"begin\":" + json_array(begins, 4) + ",\"end\":" + json_array(ends, 4) + "}";
}

/// One array per device; `quantity` is the index in the order of Run::plots.
std::string devices_json(const PlotData& data, std::size_t quantity, int decimals) {
  std::string json = "[";
  for (std::size_t d = 0; d < data.series.size() / kQuantities; ++d) {
    if (json.size() > 1) json += ',';
    json += json_array(data.series[d * kQuantities + quantity], decimals);
  }
  return json + "]";
}

/// Removed volume of each structure at the times of the plots.
std::string removed_json(const Run& run) {
  std::string mm3 = "[", of = "[";
  for (std::size_t n = 0; n < run.removal.structures.size(); ++n) {
    const LabelId label = run.removal.structures[n].label;
    if (n > 0) mm3 += ',', of += ',';
    mm3 += json_array(run.removal.removed_mm3(n, run.plots.x), 3);
    of += "{\"colour\":" + json_string(css_colour(run.colour(label))) +
          ",\"name\":" + json_string(run.name(label)) + "}";
  }
  return "\"removed\":" + mm3 + "],\"removedOf\":" + of + "]";
}

/// Force contribution of each structure, and length of the penetration path within it, at the times of the
/// plots.
std::string layers_json(const Run& run) {
  const std::size_t count = run.layer_labels.size();
  std::string structures = "[", force = "[", depth = "[";
  for (std::size_t n = 0; n < count; ++n) {
    if (n > 0) structures += ',', force += ',', depth += ',';
    structures += "{\"colour\":" + json_string(css_colour(run.colour(run.layer_labels[n]))) +
                  ",\"name\":" + json_string(run.name(run.layer_labels[n])) + "}";
    force += json_array(run.layers.series[n], 3);
    depth += json_array(run.layers.series[count + n], 3);
  }
  return "\"layers\":" + structures + "],\"layerForce\":" + force + "],\"layerDepth\":" + depth + "]";
}

/// Clearance of the tool to structures at the times of the plots.
std::string clearance_json(const Run& run, const PlanComparison& comparison) {
  std::string mm = "[", of = "[";
  for (const std::size_t n : plotted_clearances(comparison)) {
    if (of.size() > 1) mm += ',', of += ',';
    const LabelId label = comparison.approaches[n].label;
    mm += json_array(clearance_at(comparison, n, run.first.time_s, run.plots.x), 2);
    of += "{\"colour\":" + json_string(css_colour(run.colour(label))) +
          ",\"name\":" + json_string(run.name(label)) + "}";
  }
  return "\"clearance\":" + mm + "],\"clearanceOf\":" + of + "]";
}

std::string data_json(const Run& run, const RehearsedPlan* rehearsed) {
  const PlotData& data = run.plots;
  std::string json = "{\"time\":" + json_array(data.x, 4);
  json += ",\"limit\":" + devices_json(data, 0, 3);
  json += ",\"force\":" + devices_json(data, 1, 3);
  json += ",\"depth\":" + devices_json(data, 2, 3);
  json += ",\"speed\":" + devices_json(data, 3, 2);
  if (run.real_clock()) json += ",\"lateness\":[" + json_array(data.series.back(), 1) + "]";
  if (!run.removal.structures.empty()) json += "," + removed_json(run);
  if (!run.layers.series.empty()) json += "," + layers_json(run);
  if (rehearsed != nullptr) json += "," + clearance_json(run, rehearsed->comparison);
  json += ",\"contacts\":" + contacts_json(run);
  json += ",\"shown\":" + shown_json(run);
  return json + "}";
}

std::string plot(const std::string& id, const std::string& title, const std::string& description) {
  return "<div class=\"plot\"><h3 id=\"" + id + "-title\">" + title +
         "</h3><div class=\"canvas\" id=\"plot-" + id + "\" role=\"img\" aria-label=\"" +
         escape(description) + "\"></div></div>\n";
}

/// Suffix such as "; largest 0.90 mm"
std::string deepest_text(const Run& run) {
  double deepest = kGap;
  for (const StructureFigures& figure : run.structures) deepest = std::fmax(deepest, figure.max_depth_mm);
  std::string text;
  if (std::isfinite(deepest)) text += "; largest " + number(deepest, 2) + " mm";
  if (run.deeper_than_measured()) text += "; in places deeper than measured";
  return text;
}

}  // namespace

std::string plots_html(const Run& run, const RehearsedPlan* rehearsed) {
  std::string html =
      "<section class=\"card\" aria-labelledby=\"plots-title\"><h2 id=\"plots-title\">Over time</h2>\n";
  if (run.recording.ticks == 0) {
    return html + "<p class=\"empty\">The recording holds no tick.</p></section>\n";
  }
  html +=
      "<p class=\"hint\">Shaded: contacts, in the structure's colour. Drag to zoom, double-click to see all.";
  if (run.touched_in_front())
    html += " A negative depth is felt in the smoothed rim, in front of the surface.";
  if (run.depth_has_gaps())
    html += " A gap in its curve during a contact means that no surface was within reach.";
  html += "</p>\n";
  const std::string duration = " over " + number(run.duration_s, 1) + " s";
  html += plot("force", "Force sent <span class=\"unit\">N</span>",
               "Force sent" + duration + "; largest " + number(run.forces.peak_N, 2) + " N, limit " +
                   number(run.forces.highest_limit_N, 2) + " N");
  html +=
      plot("depth",
           std::string(run.is_deformable() ? "Depth below the surface at rest" : "Depth below the surface") +
               " <span class=\"unit\">mm</span>",
           "Depth of the tip below the touched surface" + duration + deepest_text(run));
  html += plot("speed", "Speed of the tip <span class=\"unit\">mm/s</span>", "Speed of the tip" + duration);
  if (!run.layers.series.empty()) {
    html += plot("layer-force", "Force by structure <span class=\"unit\">N</span>",
                 "Force of each structure" + duration);
    html += plot("layer-depth", "Depth by structure <span class=\"unit\">mm</span>",
                 "Length of the tip's path from the surface at rest inside each structure" + duration);
  }
  html += "<ul class=\"legend\" aria-label=\"Structures touched\">";
  for (const StructureFigures& figure : run.structures) {
    html += "<li>" + swatch(run.colour(figure.label)) + escape(run.name(figure.label)) + "</li>";
  }
  return html +
         "</ul>\n<noscript><p class=\"empty\">The plots need JavaScript.</p></noscript>\n"
         "<script type=\"application/json\" id=\"run-data\">" +
         data_json(run, rehearsed) + "</script></section>\n";
}

}  // namespace palpate::report
