#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/haptics/haptics.h"

/// Text that is safe to put into a page or a picture of markup, and words that pictures of a patient bear.
namespace palpate::markup {

/// For element content and quoted attributes. Control characters become spaces.
std::string escape(std::string_view text);
std::string base64(std::span<const std::uint8_t> bytes);
/// "#rrggbb"
std::string css_colour(const Rgb& colour);

/// The side of the patient that was scanned: "LEFT", "RIGHT", "SIDE UNKNOWN", empty for both sides.
std::string side_text(Side side);
/// The same as a mark in a picture: "Side: LEFT". Without orientation a mark that says so.
std::string side_mark(Side side, bool oriented);
/// What a picture says of a model's caveats of placement and side: "PLACEMENT IN DOUBT", "SIDE IN DOUBT",
/// each at most once.
std::vector<std::string> doubt_marks(const Model& model);

}  // namespace palpate::markup
