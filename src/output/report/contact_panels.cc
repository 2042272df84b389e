#include <algorithm>
#include <cmath>
#include <memory>
#include <set>

#include "palpate/rendering/rendering.h"
#include "palpate/tissue/displayed_law.h"
#include "report/html.h"
#include "report/overlay.h"
#include "report/page_sections.h"
#include "report/strain_map.h"

namespace palpate::report {
namespace {

constexpr int kGreyLevels = 64;  // sufficient next to colours, and a third smaller than 256
constexpr double kMaxArrow_mm = 20;

struct View {
  AnatomicalPlane plane;
  const char* anatomical_name;
  const char* plain_name;  ///< Used if the patient orientation is unknown
  int axis;                ///< Normal of the plane
  char positive, negative;

  std::string name(const Model& model) const { return model.oriented ? anatomical_name : plain_name; }
};
constexpr View kViews[] = {{AnatomicalPlane::kAxial, "Axial", "Plane x-y", 2, 'S', 'I'},
                           {AnatomicalPlane::kCoronal, "Coronal", "Plane x-z", 1, 'P', 'A'},
                           {AnatomicalPlane::kSagittal, "Sagittal", "Plane y-z", 0, 'L', 'R'}};

/// 70 % of the volume, within 40 ... 120 mm: enough context for orientation, and enough detail of the
/// contact.
double field_of_view_mm(const Model& model) {
  constexpr double kMin_mm = 40, kMax_mm = 120;
  if (model.labels == nullptr) return kMax_mm;
  const GridGeometry& grid = model.labels->geometry();
  double longest = 0;
  for (int axis = 0; axis < 3; ++axis) longest = std::max(longest, grid.dims[axis] * grid.spacing_mm[axis]);
  return std::clamp(10 * std::round(0.07 * longest), kMin_mm, kMax_mm);
}

}  // namespace

double arrow_mm_per_N(double limit_N) {
  if (!(limit_N > 0)) return 1;
  const double largest = kMaxArrow_mm / limit_N, decade = std::pow(10, std::floor(std::log10(largest)));
  for (const double step : {5.0, 2.0}) {
    if (step * decade <= largest) return step * decade;
  }
  return decade;
}

namespace {

/// Position of a section: "S 12.4 mm", or "z 12.4 mm" without orientation
std::string plane_position(const Model& model, const View& view, const Point<Patient>& p) {
  const double value = p[view.axis];
  if (!model.oriented) return std::string(1, "xyz"[view.axis]) + " " + number(value, 1) + " mm";
  return std::string(1, value < 0 ? view.negative : view.positive) + " " + number(std::abs(value), 1) + " mm";
}

std::string png_img(const std::string& css_class, const std::vector<std::uint8_t>& png) {
  const std::string size = std::to_string(kSection_px);
  return "<img class=\"" + css_class + "\" alt=\"\" width=\"" + size + "\" height=\"" + size +
         "\" src=\"data:image/png;base64," + base64(png) + "\">";
}

}  // namespace

SectionStyle section_style(const Model& model) {
  SectionStyle style;
  style.grey_levels = kGreyLevels;
  if (model.scan == nullptr) {
    style.label_opacity = 0.8;  // there is no scan beneath
  } else {
    const auto window = scan_window(*model.scan);
    style.window_low = window[0];
    style.window_high = window[1];
  }
  return style;
}

std::string section_layers(const Model& model, const SectionPlane& plane, const SectionStyle& style) {
  return png_img("scan", encode_png(render_scan_layer(model, plane, style))) +
         png_img("structures", encode_png(render_structure_layer(model, plane, style)));
}

namespace {

/// Inputs of a panel's sections, and the labels found in them.
struct Sections {
  const Model& model;  ///< The run's model, or the one with the remaining labels after removal
  const DisplacedTissue& deformed;
  SectionMarks marks;
  SectionStyle style;
  double width_mm = 100;
  std::string structure;
  std::set<LabelId> seen = {};
  double max_strain = 0;
};

std::string section_figure(Sections& shown, const View& view) {
  const Model& model = shown.model;
  const SectionPlane plane =
      anatomical_section(view.plane, shown.marks.contact, shown.width_mm, kSection_px, kSection_px);
  const std::vector<LabelId> labels = section_labels(model, plane, shown.style);
  for (const LabelId label : labels) {
    if (label != 0) shown.seen.insert(label);
  }
  const std::string name = view.name(model), position = plane_position(model, view, shown.marks.contact);
  const std::string description =
      name + " section through the contact with " + shown.structure + ", " + position;
  std::string strain;
  if (!shown.deformed.is_at_rest()) {
    const StrainMap map = strain_map(model, shown.deformed, shown.style.moved, plane, labels);
    shown.max_strain = std::max(shown.max_strain, map.most);
    if (map.most >= kMinStrain) strain = png_img("strain", encode_png(map.picture));
  }
  return "<figure class=\"section\"><div class=\"picture\">" + section_layers(model, plane, shown.style) +
         strain + section_svg(plane, shown.marks, description) + "</div><figcaption><span>" + name +
         "</span> <span>" + position + "</span></figcaption></figure>\n";
}

/// Note on the display of deformed tissue; empty if it is at rest.
std::string deformation_html(const Sections& shown) {
  if (shown.deformed.is_at_rest()) return "";
  const bool as_mail = shown.model.tissue_law == TissueLaw::kChainMail;
  std::string html = "<p class=\"yielded\">Tissue is drawn as deformed by the tool at the largest force, ";
  html += as_mail ? "by the chain-mail model, which does not represent forces" : "by linear elasticity";
  html += "; the outline is the tool in its dent.";
  if (!(shown.max_strain >= kMinStrain))
    return html + " No tissue in view has a strain of " + number(100 * kMinStrain, 0) + " % or more.</p>\n";
  const bool is_known = std::isfinite(shown.max_strain) && shown.max_strain < 1;
  html += " Equivalent strain in view: ";
  html += is_known ? "at most " + number(100 * shown.max_strain, 0) + " %."
                   : "more than 100 % in places" +
                         std::string(as_mail ? "." : ", which is beyond linear elasticity.");
  return html + " <span class=\"strain-key\">0 " + strain_scale_svg() + " " + number(100 * kMaxStrain, 0) +
         " % and more; less than " + number(100 * kMinStrain, 0) + " % fades out</span></p>\n";
}

std::string fact(const std::string& label, const std::string& value) {
  return "<div><dt>" + label + "</dt><dd>" + value + "</dd></div>";
}

/// Contributions such as "fat 10.0 mm, 5 %; bone 5.0 mm, 95 %", escaped.
std::string path_text(const Run& run, const DeviceTick& device) {
  std::string text;
  for (std::size_t n = 0; n < device.path_label.size() && device.path_label[n] != 0; ++n)
    text += (n == 0 ? "" : "; ") + escape(run.name(device.path_label[n])) + " " +
            depth_text(device.path_depth_mm[n]) + ", " + number(100 * device.path_share[n], 0) + " %";
  return text;
}

std::string facts(const Run& run, const ShownContact& shown) {
  const Contact& contact = shown.contact;
  const DeviceTick& peak = shown.at_peak();
  std::string html = "<dl class=\"facts\">";
  html +=
      fact("Largest force", number(contact.peak_force_N, 2) + " N at " + number(contact.peak_s, 2) + " s");
  html += fact("Depth there",
               is_deeper_than_measured(peak, run.model) ? "deeper than measured" : depth_text(peak.depth_mm));
  if (peak.path_label[0] != 0) html += fact("Structures contributing", path_text(run, peak));
  const auto& touched = contact.first_touch_mm;
  html += fact("First touched at",
               number(touched[0], 1) + ", " + number(touched[1], 1) + ", " + number(touched[2], 1) + " mm");
  html += fact("Contact", number(contact.begin_s, 2) + " to " + number(contact.end_s, 2) + " s");
  if (run.devices > 1) html += fact("Device", std::to_string(contact.device + 1));
  return html + "</dl>";
}

/// Legend of the visible structures, the touched one first, the others by name.
std::string legend(const Run& run, LabelId touched, const std::set<LabelId>& labels) {
  std::vector<std::pair<std::string, LabelId>> names;
  for (const LabelId label : labels) {
    if (label != touched) names.emplace_back(run.name(label), label);
  }
  std::sort(names.begin(), names.end());
  std::string html = "<ul class=\"legend\" aria-label=\"Structures in view\"><li class=\"touched\">" +
                     swatch(run.colour(touched)) +
                     escape(run.name(touched) + run.model.enclosing_suffix(touched)) + "</li>";
  for (const auto& [name, label] : names) html += "<li>" + swatch(run.colour(label)) + escape(name) + "</li>";
  return html + "</ul>";
}

std::string panel(const Run& run, std::size_t index, const std::string& picture, const SectionStyle& style,
                  double mm_per_N) {
  const ShownContact& shown = run.shown[index];
  const Contact& contact = shown.contact;
  const std::string number_text = std::to_string(index),
                    name = run.name(contact.label) + run.model.enclosing_suffix(contact.label);
  const auto& tip = shown.at_peak().tip_patient_mm;

  SectionMarks marks;
  marks.contact = Point<Patient>(tip[0], tip[1], tip[2]);
  marks.force_N = patient_force_N(run.model, shown.peak, contact.device);
  marks.arrow_mm_per_N = mm_per_N;
  marks.side = run.side();
  marks.oriented = run.model.oriented;
  marks.doubts = markup::doubt_marks(run.model);
  marks.paths = shown.paths;

  std::string html = "<section class=\"panel\" id=\"contact-" + number_text +
                     "\" role=\"tabpanel\" aria-labelledby=\"tab-" + number_text + "\" tabindex=\"0\"><h3>" +
                     swatch(run.colour(contact.label)) + escape(name) + "</h3><div class=\"about\">" +
                     facts(run, shown) + picture + "</div>" + "<div class=\"sections\">\n";
  auto after_removal = model_after_removal(run.model, run.removal.changes, contact.peak_s);
  if (const TissueLaw law = run.laws.at(shown.peak.model_version); law != run.model.tissue_law) {
    after_removal = std::make_shared<const Model>(
        displayed_under_law(after_removal != nullptr ? *after_removal : run.model, law));
  }
  const Model& model = after_removal != nullptr ? *after_removal : run.model;
  const DisplacedTissue deformed(model, shown.peak);
  Sections sections{model, deformed, std::move(marks), style, field_of_view_mm(run.model), name};
  if (!deformed.is_at_rest()) {
    const auto moved = [&deformed](const Point<Patient>& at_rest) {
      return deformed.displacement_mm(at_rest);
    };
    sections.style.moved = moved;
    sections.marks.tool = overlay_parts(model, shown.peak, contact.device);
    // the contact point on the undeformed surface, displaced with the tissue
    const auto& contact_mm = shown.at_peak().contact_patient_mm;
    const Vector<Patient> dent = moved(Point<Patient>(contact_mm[0], contact_mm[1], contact_mm[2]));
    for (OverlayPart& part : sections.marks.tool) part.from += dent;
  }
  for (const View& view : kViews) html += section_figure(sections, view);
  return html + "</div>\n" + deformation_html(sections) + legend(run, contact.label, sections.seen) +
         "</section>\n";
}

std::string tabs(const Run& run) {
  std::string html = "<div class=\"tabs\" role=\"tablist\" aria-label=\"Contacts\">\n";
  for (std::size_t i = 0; i < run.shown.size(); ++i) {
    const std::string index = std::to_string(i);
    const LabelId label = run.shown[i].contact.label;
    html += "<button type=\"button\" role=\"tab\" id=\"tab-" + index + "\" aria-controls=\"contact-" + index +
            "\">" + swatch(run.colour(label)) + escape(run.name(label)) + "</button>\n";
  }
  return html + "</div>\n";
}

/// @param strained  whether there are strain pictures
std::string controls(bool strained) {
  return "<div class=\"controls\"><label>Structures <input type=\"range\" id=\"structures\" min=\"0\" "
         "max=\"100\" "
         "value=\"100\" aria-label=\"Opacity of the structures\"></label><label><input type=\"checkbox\" "
         "id=\"marks\" "
         "checked> Path and force</label>" +
         std::string(strained ? "<label><input type=\"checkbox\" id=\"strain\"> Strain</label>" : "") +
         "<button type=\"button\" id=\"zoom-contact\">Show in the "
         "plots</button></div>\n";
}

std::string key(const Run& run, double mm_per_N) {
  return "<p class=\"key\"><span><svg viewBox=\"0 0 26 10\" aria-hidden=\"true\"><line class=\"way "
         "touching\" x1=\"1\" "
         "y1=\"5\" x2=\"25\" y2=\"5\"/></svg>path in contact</span><span><svg viewBox=\"0 0 26 10\" "
         "aria-hidden=\"true\"><line class=\"way\" x1=\"1\" y1=\"5\" x2=\"25\" y2=\"5\"/></svg>path 1 s "
         "before and "
         "after</span><span><svg viewBox=\"0 0 26 10\" aria-hidden=\"true\"><line class=\"force\" x1=\"1\" "
         "y1=\"5\" "
         "x2=\"18\" y2=\"5\"/><polygon class=\"force-head\" points=\"25,5 16,1 16,9\"/></svg>force on the "
         "hand at its "
         "largest, " +
         json_number(mm_per_N, 3) + " mm for 1 N</span><span>Path within " + number(kPathReach_mm, 0) +
         " mm of the plane." +
         (run.model.oriented ? " Radiological view: patient's left on the right." : "") +
         (run.removal.changes.empty()
              ? ""
              : " What a " + cutter_name(run.model) + " had removed by then is left out.") +
         "</span></p>\n";
}

}  // namespace

Result<std::string> contacts_html(const Run& run, std::span<const std::string> pictures,
                                  const Progress& progress) {
  std::string html =
      "<section class=\"card\" aria-labelledby=\"contacts-title\"><h2 id=\"contacts-title\">Contacts</h2>\n";
  if (run.shown.empty()) {
    return html + "<p class=\"empty\">No structure was touched for 50 ms or longer.</p></section>\n";
  }
  if (run.structures.size() > run.shown.size()) {
    html += "<p class=\"hint\">Sections of the " + std::to_string(run.shown.size()) +
            " structures touched longest; the table below lists all.</p>\n";
  }
  const SectionStyle style = section_style(run.model);
  const double mm_per_N = arrow_mm_per_N(run.forces.highest_limit_N);
  std::string panels;
  for (std::size_t i = 0; i < run.shown.size(); ++i) {
    if (progress.stopped()) return Progress::interrupted();
    progress.report("sections", static_cast<double>(i) / static_cast<double>(run.shown.size()));
    panels += panel(run, i, i < pictures.size() ? pictures[i] : std::string(), style, mm_per_N);
  }
  const bool strained = panels.find("class=\"strain\"") != std::string::npos;
  return html + tabs(run) + controls(strained) + "<div class=\"panels\">\n" + panels + "</div>\n" +
         key(run, mm_per_N) + "</section>\n";
}

}  // namespace palpate::report
