def judge(declared, sketch, tree, collector): return None
def warnings(declared, sketch, tree, collector): return None
