// Compiled as C++17: vtkSMPTools.h of VTK 9.1 is not C++20.
#include <vtkCellArray.h>
#include <vtkDecimatePro.h>
#include <vtkFlyingEdges3D.h>
#include <vtkImageData.h>
#include <vtkMarchingCubes.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>
#include <vtkQuadricDecimation.h>
#include <vtkSMPTools.h>
#include <vtkSmartPointer.h>
#include <vtkSynchronizedTemplates3D.h>

#include <map>

#include "tools/bench/peers/peer_engines.h"

namespace isobrick {
namespace {

int vtkTypeOf(const std::string& type_name) {
  static const std::map<std::string, int> kTypes = {
      {"uint8", VTK_UNSIGNED_CHAR}, {"int8", VTK_SIGNED_CHAR},    {"uint16", VTK_UNSIGNED_SHORT},
      {"int16", VTK_SHORT},         {"uint32", VTK_UNSIGNED_INT}, {"int32", VTK_INT},
      {"float32", VTK_FLOAT},       {"float64", VTK_DOUBLE}};
  const auto found = kTypes.find(type_name);
  if (found == kTypes.end()) throw std::runtime_error("VTK has no voxels of the type " + type_name);
  return found->second;
}

template <typename Filter>
class VtkEngine : public SurfaceEngine {
 public:
  VtkEngine(const std::string& path, double isovalue, std::string note)
      : path_(path), note_(std::move(note)) {
    filter_->SetValue(0, isovalue);
    filter_->ComputeNormalsOn();
    filter_->ComputeGradientsOff();
    filter_->ComputeScalarsOff();
    filter_->SetInputData(image_);
    last_ = filter_;
  }
  // `decimation` makes the surface smaller, which takes its normals away.
  VtkEngine(const std::string& path, double isovalue,
            vtkSmartPointer<vtkPolyDataAlgorithm> decimation)
      : VtkEngine(path, isovalue, "decimated by one thread, without normals") {
    filter_->ComputeNormalsOff();
    decimation->SetInputConnection(filter_->GetOutputPort());
    last_ = decimation;
  }

  void load() override {
    const Level0Volume volume(path_);
    const auto voxels = volume.voxels();
    image_->SetDimensions(static_cast<int>(voxels[0]), static_cast<int>(voxels[1]),
                          static_cast<int>(voxels[2]));
    spacing_ = volume.spacing();
    image_->SetSpacing(spacing_.data());
    image_->AllocateScalars(vtkTypeOf(volume.typeName()), 1);
    volume.copyTo(image_->GetScalarPointer());
  }

  void extract() override {
    filter_->Modified();
    last_->Update();
  }

  SurfaceSize size() const override {
    vtkPolyData* const mesh = output();
    constexpr std::uint64_t kBytesOfUnit = 1024;  // VTK counts in KiB
    return {static_cast<std::uint64_t>(mesh->GetNumberOfPolys()),
            static_cast<std::uint64_t>(mesh->GetNumberOfPoints()),
            kBytesOfUnit * mesh->GetActualMemorySize()};
  }

  PlainMesh mesh() const override {
    PlainMesh plain;
    vtkPolyData* const mesh = output();
    for (vtkIdType i = 0; i < mesh->GetNumberOfPoints(); ++i) {
      double world[3];
      mesh->GetPoint(i, world);
      plain.positions.push_back({static_cast<float>(world[0] / spacing_[0]),
                                 static_cast<float>(world[1] / spacing_[1]),
                                 static_cast<float>(world[2] / spacing_[2])});
    }
    vtkCellArray* const cells = mesh->GetPolys();
    for (vtkIdType i = 0; i < cells->GetNumberOfCells(); ++i) {
      vtkIdType count = 0;
      const vtkIdType* corners = nullptr;
      cells->GetCellAtId(i, count, corners);
      plain.triangles.push_back({static_cast<std::uint32_t>(corners[0]),
                                 static_cast<std::uint32_t>(corners[1]),
                                 static_cast<std::uint32_t>(corners[2])});
    }
    return plain;
  }

  std::string note() const override { return note_; }

 private:
  vtkPolyData* output() const { return last_->GetOutput(); }

  std::string path_, note_;
  std::array<double, 3> spacing_{1, 1, 1};
  vtkNew<vtkImageData> image_;
  vtkNew<Filter> filter_;
  vtkSmartPointer<vtkPolyDataAlgorithm> last_;  // of the algorithms that make the surface
};

}  // namespace

std::unique_ptr<SurfaceEngine> makeVtkEngine(const std::string& name, const std::string& path,
                                             double isovalue, int threads) {
  vtkSMPTools::Initialize(threads);
  const std::string backend = vtkSMPTools::GetBackend();
  if (name == "vtkFlyingEdges3D")
    return std::make_unique<VtkEngine<vtkFlyingEdges3D>>(path, isovalue, "threads of " + backend);
  constexpr char kOneThread[] = "always one thread";
  if (name == "vtkSynchronizedTemplates3D")
    return std::make_unique<VtkEngine<vtkSynchronizedTemplates3D>>(path, isovalue, kOneThread);
  if (name == "vtkMarchingCubes")
    return std::make_unique<VtkEngine<vtkMarchingCubes>>(path, isovalue, kOneThread);
  return nullptr;
}

std::unique_ptr<SurfaceEngine> makeVtkDecimation(const std::string& name, const std::string& path,
                                                 double isovalue, double reduction, int threads) {
  vtkSMPTools::Initialize(threads);
  if (name == "vtkQuadricDecimation") {
    const auto filter = vtkSmartPointer<vtkQuadricDecimation>::New();
    filter->SetTargetReduction(reduction);
    return std::make_unique<VtkEngine<vtkFlyingEdges3D>>(path, isovalue, filter);
  }
  const auto filter = vtkSmartPointer<vtkDecimatePro>::New();
  filter->SetTargetReduction(reduction);
  filter->PreserveTopologyOn();
  return std::make_unique<VtkEngine<vtkFlyingEdges3D>>(path, isovalue, filter);
}

}  // namespace isobrick
