class PalpateError(Exception):
    """A fault that the user can mend.

    what   the fault
    where  the node, file or address that it concerns; empty: none
    how    the remedy
    """

    def __init__(self, what, where="", how=""):
        super().__init__((f"{where}: " if where else "") + what + (f"\n{how}" if how else ""))
        self.what, self.where, self.how = what, where, how
