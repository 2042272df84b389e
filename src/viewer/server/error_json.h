#pragma once

#include <string_view>

#include "palpate/base/result.h"
#include "palpate/json/json.h"

namespace palpate::server {

/// Error as published to viewers: `what`, `how`, and `where` if that is a word of the protocol. Every error
/// in a message is serialised by this function. An error's `where` is usually a file, and names of files and
/// folders must not leave the machine; `what` and `remedy` never contain them (palpate/base/result.h).
palpate::Json error_json(const Error& error);

/// Whether a `where` is a key of a viewer's request, a missing permission, or the name of a force method or
/// of a tissue law.
bool is_word_of_protocol(std::string_view context);

}  // namespace palpate::server
