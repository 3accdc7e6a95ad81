"""For other programs: results for ParaView, spreadsheets and Blender, policies for vehicles."""

from crinoid.export.write import Written, write_csv, write_gltf, write_onnx, write_vtkhdf

__all__ = ["Written", "write_csv", "write_gltf", "write_onnx", "write_vtkhdf"]
