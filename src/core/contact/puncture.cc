#include "contact/puncture.h"

#include <algorithm>
#include <bitset>

#include "contact/capsule_row.h"
#include "contact/near_surfaces.h"

namespace palpate {
namespace {

// whether the puncture of a structure opens a surface: its own, an additional one, or a common one
bool opens(const ContactSurface& surface, std::size_t index, int structure) {
  return static_cast<int>(index) == structure || surface.structure == structure ||
         std::find(surface.opened_by.begin(), surface.opened_by.end(), structure) != surface.opened_by.end();
}

// visits the contacts of all layers, outermost first, at which the structure has the largest ownership share
template <class Visit>
void for_each_contact_of(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                         int structure, const ToolPose& tool_pose, const ProxyState& state,
                         const Visit& visit) {
  for (int n = 0; n < layer_count(surfaces); ++n) {
    const ProxyLayer& layer = state.layer(n);
    const RotatedTool turned_tool(parts, tool_pose.attitude, layer.attitude);
    for (const ProxyContact& contact :
         std::span(layer.contacts).first(static_cast<std::size_t>(layer.contact_count))) {
      const auto surface = static_cast<std::size_t>(contact.surface);
      if (!opens(surfaces[surface], surface, structure)) continue;
      const ToolPart& part = turned_tool.parts()[static_cast<std::size_t>(contact.part)];
      const double radius_mm = part.radius_at_mm(contact.axis_fraction);
      const Point<Patient> centre = layer.position + part.offset_mm + part.axis_mm * contact.axis_fraction;
      if (owners_at(surfaces, contact.surface, centre - contact.normal * radius_mm).largest() == structure)
        visit(contact, centre, radius_mm);
    }
  }
}

// Extends the permanent holes of punctured structures along the tool at the proxy of their layer. A structure
// that is not punctured is opened without force if all its contacts fit into its holes.
void enter_holes(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                 const ToolPose& tool_pose, ProxyState& state, Holes& holes) {
  std::array<int, Holes::kCapacity> structures;
  std::size_t count = 0;
  for (const Hole& hole : holes.all()) {
    const auto known = std::span(structures).first(count);
    if (std::find(known.begin(), known.end(), hole.structure) == known.end())
      structures[count++] = hole.structure;
  }
  for (const int structure : std::span(structures).first(count)) {
    const auto s = static_cast<std::size_t>(structure);
    if (const ProxyLayer& layer = state.layer(surfaces[s].layer); layer.punctured[s]) {
      const RotatedTool turned_tool(parts, tool_pose.attitude, layer.attitude);
      for (const ToolPart& part : turned_tool.parts())
        for (const double end : {0.0, 1.0})
          holes.extend(structure, layer.position + part.offset_mm + part.axis_mm * end);
      continue;
    }
    bool in_contact = false, fits = true;
    for_each_contact_of(surfaces, parts, structure, tool_pose, state,
                        [&](const ProxyContact& /*contact*/, const Point<Patient>& centre, double radius_mm) {
                          in_contact = true;
                          fits = fits &&
                                 std::any_of(holes.all().begin(), holes.all().end(), [&](const Hole& hole) {
                                   return hole.structure == structure && hole.fits(centre, radius_mm);
                                 });
                        });
    if (in_contact && fits) open_structure(surfaces, structure, state);
  }
}

// creates permanent holes where a structure with stays_open was punctured
void make_holes(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts, int structure,
                const ToolPose& tool_pose, const ProxyState& state, Holes& holes) {
  std::bitset<kMaxToolParts> done;
  for_each_contact_of(surfaces, parts, structure, tool_pose, state,
                      [&](const ProxyContact& contact, const Point<Patient>& centre, double radius_mm) {
                        // one hole per tool part, at its contact in the outermost layer
                        if (done[static_cast<std::size_t>(contact.part)]) return;
                        done[static_cast<std::size_t>(contact.part)] = true;
                        holes.add({structure, centre, -contact.normal, 0, radius_mm});
                      });
}

}  // namespace

SurfaceSet still_open(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                      const ToolPose& tool_pose, const ProxyLayer& layer) {
  SurfaceSet punctured = layer.punctured;
  if (punctured.none()) return punctured;
  const RotatedTool turned_tool(parts, tool_pose.attitude, layer.attitude);
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    if (!punctured[s]) continue;
    const auto is_clear = [&](std::span<const ToolPart> tool, const Point<Patient>& at) {
      return std::all_of(tool.begin(), tool.end(), [&](const ToolPart& part) {
        const ContactPair pair{surfaces[s].surface.get(), 0, 0, part, row_steps(part)};
        int queries = 0;
        return pair.clearance(at, kProxySettings.closing_mm, pair.steps / 2, queries).mm >
               kProxySettings.closing_mm;
      });
    };
    if (is_clear(parts, tool_pose.tip) && is_clear(turned_tool.parts(), layer.position)) punctured[s] = false;
  }
  return punctured;
}

bool is_contact_punctured(const ProxyLayer& layer) {
  const auto contacts = std::span(layer.contacts).first(static_cast<std::size_t>(layer.contact_count));
  return std::any_of(contacts.begin(), contacts.end(), [&](const ProxyContact& contact) {
    return layer.punctured[static_cast<std::size_t>(contact.surface)];
  });
}

void open_structure(std::span<const ContactSurface> surfaces, int structure, ProxyState& state) {
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    const ContactSurface& surface = surfaces[s];
    if (surface.surface != nullptr && opens(surface, s, structure))
      state.layer(surface.layer).punctured[s] = true;
  }
}

bool puncture(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
              const ToolPose& tool_pose, const PunctureForces& forces, Holes* holes, ProxyState& state) {
  if (holes != nullptr && !holes->empty()) enter_holes(surfaces, parts, tool_pose, state, *holes);
  bool any = false;
  for (std::size_t n = 0; n < forces.count(); ++n) {
    const int structure = forces.structure(n);
    const ContactSurface& surface = surfaces[static_cast<std::size_t>(structure)];
    if (!(forces.force_N(n) > surface.puncture_N)) continue;
    if (holes != nullptr && surface.stays_open)
      make_holes(surfaces, parts, structure, tool_pose, state, *holes);
    open_structure(surfaces, structure, state);
    any = true;
  }
  return any;
}

}  // namespace palpate
