"""Results for other programs: ParaView, spreadsheets and Blender."""

from crinoid.export.write import Written, write_csv, write_gltf, write_vtkhdf

__all__ = ["Written", "write_csv", "write_gltf", "write_vtkhdf"]
