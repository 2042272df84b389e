#pragma once

#include <string_view>

#include "palpate/base/result.h"
#include "palpate/json/json.h"

namespace palpate::link {

/// An error as viewers read it: `what`, `how`, and `where` if that is a word of the protocol. Every error
/// that a message carries is written by this function. An error's place is a file, more often than not, and
/// names of files and folders stay on the machine; `what` and `remedy` never contain them
/// (palpate/base/result.h).
palpate::Json told_error(const Error& error);

/// Whether a place is a key of a viewer's request, a right that it lacks, or the name of a force method or of
/// a law of soft tissue.
bool is_word_of_protocol(std::string_view place);

}  // namespace palpate::link
