#include "isobrick/viewer/egl_places.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <string_view>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

constexpr char kSurfaceless[] = "surfaceless";
constexpr char kDisplay[] = "display";

bool hasClientExtension(const char* name) { return epoxy_has_egl_extension(EGL_NO_DISPLAY, name); }

// A list of words; no word is the beginning of another one that is asked for here.
bool deviceHas(EGLDeviceEXT device, std::string_view extension) {
  const char* const all = eglQueryDeviceStringEXT(device, EGL_EXTENSIONS);
  return all != nullptr && std::string_view(all).find(extension) != std::string_view::npos;
}

std::string aboutDevice(EGLDeviceEXT device) {
  const auto say = [&](const char* extension, EGLint name) -> std::string {
    if (!deviceHas(device, extension)) return {};
    const char* const text = eglQueryDeviceStringEXT(device, name);
    return text == nullptr ? "" : text;
  };
  constexpr EGLint kRenderer = 0x335F;  // EGL_RENDERER_EXT
  const std::string renderer = say("EGL_EXT_device_query_name", kRenderer);
  if (!renderer.empty()) return renderer;
  // Mesa 22 lists EGL_EXT_device_drm_render_node for its device in software, which has no file.
  if (deviceHas(device, "EGL_MESA_device_software")) return "software";
  return say("EGL_EXT_device_drm", EGL_DRM_DEVICE_FILE_EXT);
}

std::vector<EglPlace> devicesOfMachine() {
  std::vector<EglPlace> devices;
  if (!hasClientExtension("EGL_EXT_platform_base") ||
      !hasClientExtension("EGL_EXT_platform_device") ||
      !(hasClientExtension("EGL_EXT_device_enumeration") ||
        hasClientExtension("EGL_EXT_device_base")))
    return devices;
  std::array<EGLDeviceEXT, 64> found{};
  EGLint count = 0;
  if (!eglQueryDevicesEXT(static_cast<EGLint>(found.size()), found.data(), &count)) return devices;
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i)
    devices.push_back({"device:" + std::to_string(i), aboutDevice(found[i]),
                       deviceHas(found[i], "EGL_MESA_device_software"), found[i]});
  return devices;
}

}  // namespace

std::vector<EglPlace> inOrderOfTrial(std::vector<EglPlace> devices, bool has_surfaceless) {
  std::vector<EglPlace> places;
  const auto add = [&](bool software) {
    for (const EglPlace& device : devices)
      if (device.is_software == software) places.push_back(device);
  };
  add(false);
  if (has_surfaceless) places.push_back({kSurfaceless, "", false, EGL_NO_DEVICE_EXT});
  places.push_back({kDisplay, "", false, EGL_NO_DEVICE_EXT});
  add(true);
  return places;
}

std::vector<EglPlace> chosenPlaces(const std::vector<EglPlace>& places, const std::string& wish) {
  if (wish.empty()) return places;
  std::vector<EglPlace> chosen;
  for (const EglPlace& place : places)
    if (place.name == wish || (wish == "software" && place.is_software)) chosen.push_back(place);
  if (!chosen.empty()) return chosen;
  std::string names = "software";
  for (const EglPlace& place : places) names += ", " + place.name;
  throw Error("cannot render: ISOBRICK_GRAPHICS is '" + wish +
              "', which is nothing that draws here; choose one of " + names);
}

std::vector<EglPlace> eglPlaces() {
  return inOrderOfTrial(devicesOfMachine(),
                        hasClientExtension("EGL_EXT_platform_base") &&
                            hasClientExtension("EGL_MESA_platform_surfaceless"));
}

EGLDisplay displayOf(const EglPlace& place) {
  if (place.device != EGL_NO_DEVICE_EXT)
    return eglGetPlatformDisplayEXT(EGL_PLATFORM_DEVICE_EXT, place.device, nullptr);
  if (place.name == kSurfaceless)
    return eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
  return eglGetDisplay(EGL_DEFAULT_DISPLAY);
}

}  // namespace isobrick
