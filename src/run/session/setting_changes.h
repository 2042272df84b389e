#pragma once

#include <string>

#include "palpate/base/contact_properties.h"
#include "palpate/server/viewer_host.h"
#include "palpate/servo/servo.h"

/// Effect of a viewer's request on a session, and the text of the consent question about it.
namespace palpate {

/// At most four significant digits.
std::string rounded_text(double value);

/// Reduces a request to the settings that differ from the current ones.
/// @param is_law_awaited, is_method_awaited  whether another law or method is being prepared, so that the
///                                           current one is a change, too
SettingsRequest changes_of(SettingsRequest request, const Parameters& now, TissueLaw law, bool is_law_awaited,
                           bool is_method_awaited);
/// Whether a setting could increase the force or release a restriction once the force is re-armed.
bool could_increase_force(const SettingsRequest& request, const Parameters& now);

/// "pause the force, and turn the object by 20 degrees"; empty if nothing changes.
std::string consent_text(const SettingsRequest& request, const Parameters& now);
/// "change cartilage's stiffness from 1 to 2 N/mm".
/// @param tissue  name, from a file
std::string consent_text(const std::string& tissue, const ContactProperties& before,
                         const ContactProperties& after);

}  // namespace palpate
