#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/contact/model.h"

/// Escaping of text for markup, and captions for pictures of a patient.
namespace palpate::markup {

/// Escapes text for element content and quoted attributes. Control characters become spaces.
std::string escape(std::string_view text);
std::string base64(std::span<const std::uint8_t> bytes);
/// "#rrggbb"
std::string css_colour(const Rgb& colour);

/// Scanned side of the patient: "LEFT", "RIGHT", "SIDE UNKNOWN"; empty for both sides.
std::string side_text(Side side);
/// Caption with the side: "Side: LEFT". Without orientation, a caption that says so.
std::string side_mark(Side side, bool oriented);
/// Captions for the caveats of a model about placement and side: "PLACEMENT IN DOUBT", "SIDE IN DOUBT", each
/// at most once.
std::vector<std::string> doubt_marks(const Model& model);

}  // namespace palpate::markup
