# Puts the scripts that PAGE names into it and writes the result to OUTPUT as the C++ string candela::kPageTemplate.
cmake_path(GET PAGE PARENT_PATH folder)
file(READ ${PAGE} page)
foreach(script elements.js charts.js sections.js)
  file(READ ${folder}/${script} text)
  string(REPLACE "<script src=\"${script}\"></script>" "<script>\n${text}</script>" page "${page}")
endforeach()
if(page MATCHES "<script src=")
  message(FATAL_ERROR "${PAGE} names a script that embed.cmake does not know")
endif()
string(HEX "${page}" bytes)
string(REGEX REPLACE "(..)" "'\\\\x\\1'," bytes "${bytes}")
file(WRITE ${OUTPUT} "// Made from ${PAGE} by embed.cmake.
#include \"client/cli/commands/report/files.h\"

namespace candela {

static constexpr char kBytes[] = {${bytes}};
const absl::string_view kPageTemplate(kBytes, sizeof kBytes);

}  // namespace candela
")
