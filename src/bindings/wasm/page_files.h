#pragma once

#include <string>
#include <string_view>

#include "palpate/loading/loading.h"

namespace palpate::wasm {

/// Source of a scene made of the files that the page was given, which lie in the current folder: a label map,
/// a scan or both, found by their content, a table of names, and files that these name. A scene file (.toml)
/// is the scene itself. Structures of unknown names are touchable, and no tissue deforms.
/// @param names  names of the files, one a line
/// Errors: none of the files is a volume (the text names what they are); more than one label map and one
/// scan.
Result<SceneSource> source_of_files(std::string_view names);

}  // namespace palpate::wasm
