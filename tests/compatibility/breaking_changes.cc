#include "tests/compatibility/breaking_changes.h"

#include <algorithm>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/settings.h"

namespace candela::testing {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::DescriptorPool;
using google::protobuf::EnumDescriptor;
using google::protobuf::EnumValueDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::FileDescriptor;
using google::protobuf::MethodDescriptor;
using google::protobuf::OneofDescriptor;
using google::protobuf::ServiceDescriptor;

std::string type_name(const FieldDescriptor& field) {
  if (field.message_type() != nullptr) return field.message_type()->full_name();
  if (field.enum_type() != nullptr) return field.enum_type()->full_name();
  return field.type_name();
}

std::string cardinality(const FieldDescriptor& field) {
  if (field.real_containing_oneof() != nullptr) {
    return "in the oneof " + field.real_containing_oneof()->name();
  }
  if (field.is_repeated()) return field.is_packed() ? "repeated, packed" : "repeated";
  return field.has_presence() ? "with presence" : "without presence";
}

std::string stream_or_not(bool stream) { return stream ? "a stream" : "one message"; }

class Comparison {
 public:
  explicit Comparison(const FileDescriptor& newer) : newer_(newer), pool_(*newer.pool()) {}

  void compare(const FileDescriptor& older) {
    expect_same(older.name(), "package", older.package(), newer_.package());
    for (int i = 0; i < older.message_type_count(); ++i) compare(*older.message_type(i));
    for (int i = 0; i < older.enum_type_count(); ++i) compare(*older.enum_type(i));
    for (int i = 0; i < older.service_count(); ++i) compare(*older.service(i));
    for (int i = 0; i < older.extension_count(); ++i) {
      const FieldDescriptor& extension = *older.extension(i);
      compare(extension, pool_.FindExtensionByName(extension.full_name()));
    }
  }

  std::vector<std::string> changes;

 private:
  void expect_same(const std::string& what, const std::string& property, const std::string& was,
                   const std::string& is) {
    if (was != is) changes.push_back(absl::StrCat(what, ": ", property, " was ", was, " and is ", is));
  }

  bool expect_present(const std::string& what, const void* found) {
    if (found == nullptr) changes.push_back(what + ": is missing");
    return found != nullptr;
  }

  void compare(const Descriptor& older) {
    const Descriptor* is = pool_.FindMessageTypeByName(older.full_name());
    if (!expect_present(older.full_name(), is)) return;
    for (int i = 0; i < older.field_count(); ++i) {
      compare(*older.field(i), is->FindFieldByName(older.field(i)->name()));
    }
    for (int i = 0; i < older.real_oneof_decl_count(); ++i) {
      const OneofDescriptor& oneof = *older.oneof_decl(i);
      expect_present(oneof.full_name(), is->FindOneofByName(oneof.name()));
    }
    for (int i = 0; i < is->field_count(); ++i) {
      const FieldDescriptor& field = *is->field(i);
      if (older.IsReservedNumber(field.number())) reserved(field.full_name(), absl::StrCat(field.number()));
      if (older.IsReservedName(field.name())) reserved(field.full_name(), field.name());
    }
    for (int i = 0; i < older.nested_type_count(); ++i) compare(*older.nested_type(i));
    for (int i = 0; i < older.enum_type_count(); ++i) compare(*older.enum_type(i));
  }

  void compare(const FieldDescriptor& older, const FieldDescriptor* is) {
    const std::string& name = older.full_name();
    if (!expect_present(name, is)) return;
    expect_same(name, "number", absl::StrCat(older.number()), absl::StrCat(is->number()));
    expect_same(name, "JSON name", older.json_name(), is->json_name());
    expect_same(name, "type", type_name(older), type_name(*is));
    expect_same(name, "cardinality", cardinality(older), cardinality(*is));
    const bool was_setting = older.options().HasExtension(v1::setting);
    if (was_setting && !is->options().HasExtension(v1::setting)) {
      changes.push_back(name + ": is no longer a setting");
    } else if (was_setting) {
      compare_settings(older, older.options().GetExtension(v1::setting),
                       is->options().GetExtension(v1::setting));
    }
  }

  // A setting's default stays and its range does not shrink, also with each choice that brings an exception.
  // A choice that the older contract lacks may bring anything.
  void compare_settings(const FieldDescriptor& older, const v1::Setting& was, const v1::Setting& is) {
    compare_values(older.full_name(), was, is);
    std::set<std::pair<std::string, std::string>> choices;
    for (const v1::Setting* setting : {&was, &is}) {
      for (const v1::Setting::Exception& exception : setting->except()) {
        choices.emplace(exception.choice(), exception.word());
      }
    }
    for (const auto& [choice, word] : choices) {
      const FieldDescriptor* field = older.containing_type()->FindFieldByName(choice);
      if (field == nullptr) continue;
      const std::vector<std::string> words = v1::enum_words(*field->enum_type());
      if (std::find(words.begin(), words.end(), word) == words.end()) continue;
      compare_values(absl::StrCat(older.full_name(), " with ", choice, " ", word),
                     in_force(was, choice, word), in_force(is, choice, word));
    }
  }

  void compare_values(const std::string& name, const v1::Setting& was, const v1::Setting& is) {
    expect_same(name, "default", default_text(was), default_text(is));
    if (is.min() > was.min() || is.max() < was.max()) {
      expect_same(name, "range", v1::format_range(was.min(), was.max()),
                  v1::format_range(is.min(), is.max()));
    }
  }

  static v1::Setting in_force(const v1::Setting& setting, const std::string& choice,
                              const std::string& word) {
    v1::Setting result = setting;
    for (const v1::Setting::Exception& exception : setting.except()) {
      if (exception.choice() != choice || exception.word() != word) continue;
      if (exception.has_max()) result.set_max(exception.max());
      if (exception.has_default_()) result.set_default_(exception.default_());
      if (!exception.default_word().empty()) result.set_default_word(exception.default_word());
    }
    return result;
  }

  static std::string default_text(const v1::Setting& setting) {
    if (setting.has_default_()) return v1::format_number(setting.default_());
    return setting.default_word().empty() ? "none" : setting.default_word();
  }

  void compare(const EnumDescriptor& older) {
    const EnumDescriptor* is = pool_.FindEnumTypeByName(older.full_name());
    if (!expect_present(older.full_name(), is)) return;
    for (int i = 0; i < older.value_count(); ++i) {
      const EnumValueDescriptor& was = *older.value(i);
      const EnumValueDescriptor* value = is->FindValueByName(was.name());
      if (!expect_present(was.full_name(), value)) continue;
      expect_same(was.full_name(), "number", absl::StrCat(was.number()), absl::StrCat(value->number()));
    }
    for (int i = 0; i < is->value_count(); ++i) {
      const EnumValueDescriptor& value = *is->value(i);
      if (older.IsReservedNumber(value.number())) reserved(value.full_name(), absl::StrCat(value.number()));
      if (older.IsReservedName(value.name())) reserved(value.full_name(), value.name());
    }
  }

  void compare(const ServiceDescriptor& older) {
    const ServiceDescriptor* is = pool_.FindServiceByName(older.full_name());
    if (!expect_present(older.full_name(), is)) return;
    for (int i = 0; i < older.method_count(); ++i) {
      const MethodDescriptor& was = *older.method(i);
      const MethodDescriptor* method = is->FindMethodByName(was.name());
      const std::string& name = was.full_name();
      if (!expect_present(name, method)) continue;
      expect_same(name, "request", was.input_type()->full_name(), method->input_type()->full_name());
      expect_same(name, "answer", was.output_type()->full_name(), method->output_type()->full_name());
      expect_same(name, "request", stream_or_not(was.client_streaming()),
                  stream_or_not(method->client_streaming()));
      expect_same(name, "answer", stream_or_not(was.server_streaming()),
                  stream_or_not(method->server_streaming()));
    }
  }

  void reserved(const std::string& what, const std::string& of) {
    changes.push_back(absl::StrCat(what, ": uses the reserved ", of));
  }

  const FileDescriptor& newer_;
  const DescriptorPool& pool_;
};

}  // namespace

std::vector<std::string> breaking_changes(const FileDescriptor& older, const FileDescriptor& newer) {
  Comparison comparison(newer);
  comparison.compare(older);
  return comparison.changes;
}

}  // namespace candela::testing
