// The properties that an XMP packet has of gain maps. Internal to client/image.
#pragma once

#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace candela {

// What a name belongs to, by its URI. Names of other spaces are left out.
enum class XmpSpace {
  kOther,
  kRdf,            // http://www.w3.org/1999/02/22-rdf-syntax-ns#
  kGainMap,        // http://ns.adobe.com/hdr-gain-map/1.0/
  kContainer,      // http://ns.google.com/photos/1.0/container/
  kContainerItem,  // http://ns.google.com/photos/1.0/container/item/
  kAppleGainMap    // http://ns.apple.com/HDRGainMap/1.0/
};

struct XmpProperty {
  XmpSpace space;
  std::string name;   // without prefix
  std::string value;  // without white space around it
  int item;           // grows from each rdf:li and Container:Item to the next, in the packet's order
};

// Reads them by libexpat, as attributes and as elements, under any prefix, and in rdf:Seq and other nesting:
// a value belongs to the innermost name around it that is not RDF's. Source: ISO 16684-1. Nothing if the
// packet is no whole XML, declares a document type, or is nested deeper than 32 elements.
std::vector<XmpProperty> xmp_properties(absl::string_view packet);

}  // namespace candela
