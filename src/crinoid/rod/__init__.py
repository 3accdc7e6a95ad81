"""Rod: mass and section, and its shape without load.

May import ``numerics`` and lower folders.
"""

from crinoid.rod.reference import Rod as Rod
